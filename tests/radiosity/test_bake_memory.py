"""What is said of a bake's memory before it begins, beside what it takes."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

BAKING = """
import json
from luxel.radiosity.bake import bake
from luxel.radiosity.diagnosis import estimate
from luxel.scene.builtin import cornell_box

def bytes_of(what):
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) << 10 for line in file if line.startswith(what))

bake(cornell_box(), density=20)
scene, before = cornell_box(), bytes_of("VmRSS")
baked = bake(scene, density=250)
taken = bytes_of("VmHWM") - before
luxels, triangles = len(baked.luxels.area), sum(len(mesh.triangles) for mesh in scene.meshes)
print(json.dumps([luxels, taken, estimate(luxels, triangles)[0]]))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads in /proc how much memory a process has taken")
def test_a_bake_takes_no_more_than_is_said_and_not_far_less():
    done = subprocess.run([sys.executable, "-c", BAKING], capture_output=True, text=True, timeout=300, check=True)
    luxels, taken, said = json.loads(done.stdout)
    assert luxels > 100_000, luxels
    assert taken < said < 3 * taken
