"""`luxel bake`, from the command line."""

import json
import os
import signal
import subprocess
import sys
import time
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

import luxel
from luxel.cli import main
from luxel.cli.console import _Bar
from luxel.cli.watch import Doing, Watch, shares, stages
from luxel.io.images import read_image, write_exr, write_png
from luxel.scene import Light
from luxel.scene.builtin import cornell_box

pytest.importorskip("xatlas")
QUICK = ("--quality", "draft", "--density", "25")


@pytest.fixture
def box(tmp_path):
    """The Cornell box with its lamp alone."""
    scene = cornell_box()
    scene.lights, scene.ambient = [], None
    luxel.save(scene, tmp_path / "box.glb")
    return tmp_path / "box.glb"


def bake(capsys, *words):
    """What a bake says as JSON."""
    assert main(["bake", *map(str, words), "--json"]) == 0
    out, _ = capsys.readouterr()
    return json.loads(out)


def error_of(capsys, *words):
    code = main(["bake", *map(str, words)])
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    assert err.startswith("luxel: error: ")
    assert err.count("\n") == 1
    return err


def test_a_file_becomes_a_lit_file(capsys, box, tmp_path):
    said = bake(capsys, box, "-o", tmp_path / "lit.glb", *QUICK, "--preview", tmp_path / "p.png", "--ao", "0.1")
    assert said["output"] == [str(tmp_path / "lit.glb"), str(tmp_path / "p.png")]
    assert said["finished"]
    assert said["unshot"] <= 0.005
    watts = {name: np.array(value) for name, value in said["watts"].items()}
    assert np.allclose(watts["emitted"], watts["absorbed"] + watts["escaped"] + watts["unshot"], rtol=1e-4)
    lit = luxel.load(tmp_path / "lit.glb")
    material = next(m for m in lit.materials if m.name == "white")
    light = lit.textures[material.lightmap_texture.texture].image
    assert light.dtype == np.float32
    assert light.max() > 0.1
    assert material.occlusion_texture is not None
    assert read_image(tmp_path / "p.png").shape == (540, 960, 4)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["box.glb", "lit.glb", "p.png"]


def test_people_read_one_line(capsys, box, tmp_path):
    assert main(["bake", str(box), "-o", str(tmp_path / "lit.gltf"), *QUICK, "--convention", "unlit", "--white", "20"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"{tmp_path / 'lit.gltf'}  (1,")
    assert "luxels on a page of" in out
    assert out.count("\n") == 1
    assert {m.shading for m in luxel.load(tmp_path / "lit.gltf").materials} == {"unlit"}


def test_exr_files_and_indirect_light_alone(capsys, box, tmp_path):
    pytest.importorskip("OpenEXR")
    whole = bake(capsys, box, "-o", tmp_path / "a.glb", *QUICK, "--convention", "sidecar")
    part = bake(capsys, box, "-o", tmp_path / "b.glb", *QUICK, "--exr", "--only-indirect")
    a, b = read_image(whole["output"][1]), read_image(part["output"][1])
    assert a.shape == b.shape
    assert b.sum() < 0.9 * a.sum()
    assert b.sum() > 0.1 * a.sum()


def test_skies_light_a_scene_without_lamps(capsys, tmp_path):
    luxel.save(luxel.scene.builtin.plane(), tmp_path / "plane.ply")
    picture = np.zeros((64, 128, 3), np.uint8)
    picture[:32] = 255  # white above
    write_png(tmp_path / "sky.png", picture)
    means = {}
    for sky in ("2", "2,2,2", "0,0,1", str(tmp_path / "sky.png")):
        said = bake(capsys, tmp_path / "plane.ply", "-o", tmp_path / "lit.glb", "--quality", "draft", "--density", "8", "--sky", sky)
        means[sky] = said["mean_irradiance"]
    assert means["2"] == means["2,2,2"] == pytest.approx([2 * np.pi] * 3, rel=0.02)
    assert means["0,0,1"] == pytest.approx([0, 0, np.pi], rel=0.02)
    assert means[str(tmp_path / "sky.png")] == pytest.approx([np.pi] * 3, rel=0.02)


def test_dry_run_tells_and_writes_nothing(capsys, box, tmp_path):
    said = bake(capsys, box, "--dry-run", "--density", "50")
    assert said["serves"]
    assert said["density"]["median"] == pytest.approx(50, rel=0.05)
    assert main(["bake", str(box), "--dry-run"]) == 0
    out = capsys.readouterr().out
    assert all(word in out for word in ("luxels", "overlap", "memory", "time"))
    assert [p.name for p in tmp_path.iterdir()] == ["box.glb"]


def test_what_was_stopped_goes_on_to_the_same_light(capsys, box, tmp_path):
    words = (box, "-o", tmp_path / "a.glb", *QUICK)
    whole = bake(capsys, *words)
    begun = bake(capsys, box, "-o", tmp_path / "b.glb", *QUICK, "--seconds", "1e-9")
    assert not begun["finished"]
    assert (tmp_path / "b.glb.state").is_file()
    ended = bake(capsys, box, "-o", tmp_path / "b.glb", *QUICK, "--resume", "--threads", "1")
    assert ended["finished"]
    assert begun["unshot"] > ended["unshot"] == whole["unshot"]
    assert not (tmp_path / "b.glb.state").exists()
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()
    assert main(["bake", *map(str, words), "--resume", "-q"]) == 0  # nothing to resume is no fault


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_an_interrupted_bake_keeps_its_state_and_writes_nothing_half(box, tmp_path):
    out, preview = tmp_path / "lit.glb", tmp_path / "p.png"
    words = ["bake", box, "-o", out, "--quality", "final", "--density", "100", "--tolerance", "1e-7", "--preview", preview]
    process = subprocess.Popen([sys.executable, "-m", "luxel", *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 240
    while not preview.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "--resume goes on" in err
    assert sorted(os.listdir(tmp_path)) == ["box.glb", "lit.glb.state", "p.png"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--quality", "best"), "--quality: expected one of draft, normal, final, progressive, reference, got 'best'"),
        (("--density", "0"), "--density: expected a number above 0"),
        (("--tolerance", "2"), "--tolerance: expected a share between 0 and 1"),
        (("--convention", "mozz"), "did you mean moz?"),
        (("--white", "-1"), "--white: expected a radiance above 0"),
        (("--page", "4"), "--page: expected a whole number from 16"),
        (("--ao", "none"), "--ao: expected metres above 0"),
        (("--sky", "blue"), "--sky: expected a number, R,G,B, or a picture"),
        (("--sky", "-1"), "--sky: expected radiance of at least 0"),
        (("--sky", "none.hdr"), "none.hdr"),
        (("-o", "lit.obj"), "expected a file name that ends in one of .glb, .gltf"),
        (("-o", "none/lit.glb"), "there is no folder 'none'"),
        (("--preview", "p.exr"), "--preview: expected a file name that ends in one of .png"),
        (("--checkpoint", "none/state"), "there is no folder"),
        (("--threads", "0"), "--threads: expected a whole number"),
    ],
)
def test_wrong_words_are_told_before_the_file_is_read(capsys, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    assert said in error_of(capsys, tmp_path / "missing.glb", *words)
    assert not list(tmp_path.iterdir())


def test_a_scene_without_light(capsys, tmp_path):
    luxel.save(luxel.scene.builtin.plane(), tmp_path / "plane.ply")
    said = error_of(capsys, tmp_path / "plane.ply", "-o", tmp_path / "lit.glb", "--density", "4")
    assert "nothing shines" in said
    assert "--sky 1" in said
    assert [p.name for p in tmp_path.iterdir()] == ["plane.ply"]


def test_a_dry_run_looks_at_the_light_too(capsys, tmp_path):
    luxel.save(luxel.scene.builtin.plane(), tmp_path / "plane.ply")
    assert main(["bake", str(tmp_path / "plane.ply"), "--dry-run", "--json"]) == 2
    out, err = capsys.readouterr()
    said = json.loads(out)
    assert said["serves"]
    assert "nothing shines" in said["refused"]
    assert "a bake would be refused: bake: nothing shines" in err
    assert "--sky 1" in err
    assert "--sky" in error_of(capsys, tmp_path / "plane.ply", "--dry-run", "--sky", "blue")


def test_a_disk_without_room_is_found_when_the_bake_begins(capsys, box, tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=1_100_000))
    said = error_of(capsys, box, "--quiet", "-o", tmp_path / "lit.glb", "--density", "120", "--page", "256", "--quality", "draft")
    assert "MB will be needed, and the disk has 1 MB left" in said
    assert sorted(os.listdir(tmp_path)) == ["box.glb"]  # no state of a bake that has not begun


def test_a_little_bake_needs_a_little_room(capsys, box, tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=500_000))
    assert bake(capsys, box, "-o", tmp_path / "lit.glb", *QUICK)["finished"]
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) < 500_000


def test_layers_and_occlusion_need_room_of_their_own(capsys, tmp_path, monkeypatch):
    """What is said to be needed grows by what each writes."""
    pytest.importorskip("OpenEXR")
    scene = cornell_box()
    scene.lights, scene.ambient = [Light("point", name=f"lamp {k}") for k in range(20)], None
    luxel.save(scene, tmp_path / "box.glb")
    asked = []
    monkeypatch.setattr("luxel.radiosity.output.check_writable", lambda path, size=0: asked.append(size))
    for words in ((), ("--ao", "0.1"), ("--exr",), ("--layers",)):
        said = bake(capsys, tmp_path / "box.glb", "-o", tmp_path / "lit.glb", *QUICK, *words)
        texels = said["pages"] * said["page"][0] * said["page"][1]
        room = asked[-1]
        if not words:
            plain = room
        more = {"--ao": 1, "--exr": 10, "--layers": 10 * (1 + 1 + 20)}  # the whole, the box's lamp, and twenty
        assert room == plain + texels * sum(more[word] for word in words[:1])


def test_a_bake_that_does_not_fit_is_refused_by_a_dry_run_too(capsys, box, monkeypatch):
    monkeypatch.setattr("luxel.radiosity.diagnosis.free_bytes", lambda: 1 << 30)
    whole = error_of(capsys, box, "--density", "100000", "--quiet")
    assert "would take about" in whole
    assert error_of(capsys, box, "--density", "100000", "--dry-run") == whole
    monkeypatch.setattr("luxel.radiosity.diagnosis.free_bytes", lambda: 100 << 20)
    assert main(["bake", str(box), "--dry-run"]) == 2
    out, err = capsys.readouterr()
    assert "luxels " in out
    assert "a bake would be refused: bake: " in err


def test_a_page_too_small_for_the_density_is_told(capsys, box, tmp_path):
    assert main(["bake", str(box), "-o", str(tmp_path / "lit.glb"), "--quality", "draft", "--density", "50", "--page", "16"]) == 0
    err = capsys.readouterr().err
    assert "do not fit on pages of 16 texels" in err
    assert "where 50 were asked for" in err


def test_no_shots_are_told_of_where_nothing_shoots(capsys, tmp_path):
    luxel.save(luxel.scene.builtin.plane(), tmp_path / "plane.ply")
    assert main(["bake", str(tmp_path / "plane.ply"), "-o", str(tmp_path / "lit.glb"), "--quality", "draft", "--density", "4", "--sky", "1"]) == 0
    assert "(16 luxels on a page of 4x4, 0.00% unshot; " in capsys.readouterr().out


def test_white_of_a_number_is_the_number(capsys, box, tmp_path):
    assert bake(capsys, box, "-o", tmp_path / "lit.glb", *QUICK, "--white", "1.0")["finished"]
    assert "--white: only of --convention unlit" in error_of(capsys, box, "-o", tmp_path / "lit.glb", "--white", "2")


@pytest.mark.parametrize("quality", ["draft", "final", "progressive"])
def test_the_bar_is_not_full_before_the_end(box, quality):
    """It never goes back, and the last bounce, when all light is shot, has a part of it."""
    done, unshot, parts = [], [], shares({"quality": quality, "sky": None})
    watch = Watch(lambda bar, label: done.append(bar), None, 1e-3, parts, lambda _: None)
    luxel.bake(box, quality=quality, density=25, progress=lambda left, state: (unshot.append(left), watch(left, state)))
    assert all(0 <= a <= b + 1e-12 <= 1 + 1e-9 for a, b in pairwise(done))
    assert done[-1] == pytest.approx(1.0)
    shot = done[next(k for k, left in enumerate(unshot) if left <= 1e-3)]
    assert shot == pytest.approx(1 - parts[2], abs=1e-6)
    assert {"draft": 0 < parts[2] < 0.5, "final": parts[2] > 0.5, "progressive": parts[2] == 0}[quality]


def test_the_layout_shows_how_long_it_takes(monkeypatch):
    now, shown, labels = [100.0], [], []
    monkeypatch.setattr("luxel.cli.watch.time", SimpleNamespace(monotonic=lambda: now[0]))
    told = stages(lambda share, label: (shown.append((share, str(label))), labels.append(label)))
    for passed, share, doing in ((0, 0.0, "laying out"), (7, 0.5, "laying out"), (2, 0.0, "finding luxels"), (3, 0.0, "finding luxels")):
        now[0] += passed
        told(share, doing)
    assert shown == [(0.0, "laying out, 0 s"), (0.5, "laying out, 7 s"), (0.0, "finding luxels, 0 s"), (0.0, "finding luxels, 3 s")]
    now[0] += 50
    assert str(labels[-1]) == "finding luxels, 53 s"  # it goes on where nothing more is told


def test_a_bar_begins_anew_with_another_part_of_the_work(monkeypatch):
    """And the time that is left is guessed from that part's own pace."""
    monkeypatch.setattr("luxel.cli.console.PATIENCE", 0.0)
    bar = _Bar("laying out", shown=True)
    try:
        for done in (0.2, 0.6, 0.9):
            bar.report(done)
        bar.report(0.1, "shooting")
        task = bar.progress.tasks[0]
        assert (task.completed, task.description) == (0.1, "shooting")
        assert len(task._progress) <= 1  # samples of the pace
        doing = Doing("cutting patches")
        bar.report(0.2, doing)
        doing.since -= 50
        assert bar.progress.columns[0](task).plain == "cutting patches, 50 s"  # as it is when it is shown
    finally:
        bar.close()


def test_lamps_can_be_left_out(capsys, tmp_path):
    scene = cornell_box()
    scene.lights, scene.ambient = [Light("point", intensity=0.2, world_from_light=luxel.scene.transforms.translation((0.3, 0.3, 0.3)))], None
    luxel.save(scene, tmp_path / "box.glb")
    bake(capsys, tmp_path / "box.glb", "-o", tmp_path / "lit.glb", *QUICK)
    assert len(luxel.load(tmp_path / "lit.glb").lights) == 1
    bake(capsys, tmp_path / "box.glb", "-o", tmp_path / "lit.glb", *QUICK, "--no-lights")
    assert not luxel.load(tmp_path / "lit.glb").lights


def test_skies_may_be_of_any_range(capsys, tmp_path):
    pytest.importorskip("OpenEXR")
    luxel.save(luxel.scene.builtin.plane(), tmp_path / "plane.ply")
    write_exr(tmp_path / "sky.exr", {"": np.full((64, 128, 3), 7, np.float32)})
    said = bake(capsys, tmp_path / "plane.ply", "-o", tmp_path / "lit.glb", "--quality", "draft", "--density", "8", "--sky", tmp_path / "sky.exr")
    assert said["mean_irradiance"] == pytest.approx([7 * np.pi] * 3, rel=0.02)


def test_layers_are_of_one_lamp_each_and_sum_to_the_whole(capsys, tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    scene = cornell_box()
    place = luxel.scene.transforms.translation((0.3, 0.45, 0.3))  # above the tall block
    scene.lights, scene.ambient = [Light("point", intensity=0.2, world_from_light=place, name="spark")], None
    luxel.save(scene, tmp_path / "box.glb")
    said = bake(capsys, tmp_path / "box.glb", "-o", tmp_path / "lit.glb", *QUICK, "--layers", "--tolerance", "1e-4")
    assert said["output"] == [str(tmp_path / "lit.glb"), str(tmp_path / "lit_layers_0.exr")]
    with OpenEXR.File(said["output"][1], separate_channels=True) as file:
        layers = {}
        for name, channel in file.channels().items():
            if name.endswith("R"):
                layers[name] = np.array(channel.pixels)
    whole = layers.pop("R")
    assert len(layers) == 2
    assert any("spark" in name for name in layers)
    assert all(layer.max() > 0.01 for layer in layers.values())
    assert np.abs(sum(layers.values()) - whole).max() < 0.03 * whole.max()


def test_device(capsys, box, tmp_path, monkeypatch):
    """Without a GPU `cuda` is an error before the scene is laid out, and `auto` bakes on the processor."""
    pytest.importorskip("numba_cuda")
    from luxel.cuda import device, door

    device.gpu.cache_clear()
    monkeypatch.setattr(door, "initialise", lambda: (_ for _ in ()).throw(OSError("CUDA driver library cannot be found.")))
    assert "expected an NVIDIA GPU and its driver" in error_of(capsys, box, "-o", tmp_path / "a.glb", *QUICK, "--device", "cuda")
    assert "--device" in error_of(capsys, box, "-o", tmp_path / "a.glb", *QUICK, "--device", "gpu")
    assert main(["bake", str(box), "-o", str(tmp_path / "a.glb"), *QUICK, "--device", "auto"]) == 0
    assert "baking on the processor" in capsys.readouterr().err
    assert (tmp_path / "a.glb").exists()
    device.gpu.cache_clear()


def test_the_scene_itself_is_no_output(box, tmp_path, capsys):
    before = box.read_bytes()
    assert main(["bake", str(box), "-o", str(box), "--quality", "draft"]) == 2
    assert "is the scene itself" in capsys.readouterr().err
    assert box.read_bytes() == before


def test_nothing_that_is_read_or_written_is_lost_to_the_checkpoint(box, tmp_path, capsys, monkeypatch):
    """The state is written over what is there, and removed in the end."""
    monkeypatch.chdir(tmp_path)
    before = box.read_bytes()
    write_png(tmp_path / "sky.png", np.full((4, 8, 3), 200, np.uint8))
    (tmp_path / "notes").write_text("dear diary")
    out = ("-o", "lit.glb", *QUICK)
    assert "--checkpoint: box.glb is the scene itself: expected another file" in error_of(capsys, "box.glb", *out, "--checkpoint", "box.glb")
    assert "lit.glb is what --output writes: expected another file" in error_of(capsys, "box.glb", *out, "--checkpoint", tmp_path / "lit.glb")
    assert "--preview: sky.png is --sky itself" in error_of(capsys, "box.glb", *out, "--sky", "sky.png", "--preview", "sky.png")
    assert "--checkpoint: notes is something else, and would be lost" in error_of(capsys, "box.glb", *out, "--checkpoint", "notes")
    assert sorted(os.listdir()) == ["box.glb", "notes", "sky.png"]
    assert box.read_bytes() == before
    assert (tmp_path / "notes").read_text() == "dear diary"
    for resumes in ((), ("--resume",), ()):
        assert not bake(capsys, "box.glb", *out, "--checkpoint", "state", "--seconds", "1e-9", *resumes)["finished"]


def test_an_earlier_bake_s_state_is_not_taken_for_this_one_s(box, tmp_path, capsys, monkeypatch):
    words = (box, "-o", tmp_path / "lit.glb", *QUICK)
    assert not bake(capsys, *words, "--seconds", "1e-9")["finished"]

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("luxel.radiosity.prepare.find_luxels", interrupted)
    for resumes, said in (((), "there was no light yet, so nothing is kept"), (("--resume",), "--resume goes on")):
        assert main(["bake", *map(str, words), *resumes]) == 130
        assert said in capsys.readouterr().err
    assert (tmp_path / "lit.glb.state").exists()


def test_triangles_without_area_are_told(tmp_path, capsys):
    scene = cornell_box()
    scene.meshes[0].triangles = np.concatenate([scene.meshes[0].triangles, [[0, 0, 1]]]).astype(np.int32)
    luxel.save(scene, tmp_path / "flat.glb")
    assert main(["bake", str(tmp_path / "flat.glb"), "-o", str(tmp_path / "lit.glb"), "--quality", "draft", "--density", "8"]) == 0
    assert "1 triangle has no area, and no light" in capsys.readouterr().err


def test_as_many_triangles_have_no_area_as_info_says(tmp_path, capsys):
    """Also slivers whose area is above nothing in float64 alone."""
    corners = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0], [0.3, 1e-9, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 0, 1]], np.int32)
    path = tmp_path / "flat.ply"
    luxel.save(luxel.Scene.from_mesh(luxel.Mesh(corners, faces)), path)
    assert main(["info", str(path), "--json"]) == 0
    odd = {o["kind"]: o["count"] for o in json.loads(capsys.readouterr().out)["oddities"]}
    assert odd["degenerate triangles"] == 2
    assert main(["bake", str(path), "-o", str(tmp_path / "lit.glb"), "--quality", "draft", "--density", "8", "--sky", "1"]) == 0
    assert "2 triangles have no area, and no light" in capsys.readouterr().err
