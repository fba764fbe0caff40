"""A machine without any graphics library: no GL, EGL, GLX, OSMesa, Vulkan, X11 or Wayland can be loaded, and there is no display."""

import subprocess
import sys

_CHILD = r"""
import ctypes, ctypes.util, importlib.abc, os, pathlib, re, sys

NAMES = "GL|EGL|GLX|GLES|OpenGL|OSMesa|vulkan|X11|xcb|wayland|gbm|drm|cuda|nvidia"
GRAPHICS = re.compile(rf"lib({NAMES})[\w-]*[.\d]*(\.so|\.dylib|\.dll|$)", re.IGNORECASE)
for name in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR"):
    os.environ.pop(name, None)
asked = []


def hidden(original):
    def open_library(self, name=None, *rest, **more):
        if name and GRAPHICS.search(os.path.basename(str(name))):
            asked.append(name)
            raise OSError(f"{name}: cannot open shared object file")
        return original(self, name, *rest, **more)
    return open_library


class Hide(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("OpenGL", "moderngl", "glcontext", "glfw", "pyglet", "vulkan", "wgpu", "tkinter"):
            asked.append(name)
            raise ImportError(f"{name} is hidden")


ctypes.CDLL.__init__ = hidden(ctypes.CDLL.__init__)
find = ctypes.util.find_library
ctypes.util.find_library = lambda name: None if GRAPHICS.search(f"lib{name}") else find(name)
sys.meta_path.insert(0, Hide())

for library in ("libGL.so.1", "libEGL.so.1", "libvulkan.so.1", "libX11.so.6", "libOSMesa.so.8"):  # the hiding works
    try:
        ctypes.CDLL(library)
    except OSError:
        continue
    sys.exit(f"{library} could be loaded")
asked.clear()

import luxel
from luxel.scene.builtin import bumpy_sphere_scene

picture = luxel.render(bumpy_sphere_scene(24), size=(96, 64), samples=4, outputs=("color", "depth", "triangle"))
picture.save(sys.argv[1])
covered = int((picture.triangle >= 0).sum())
maps = pathlib.Path("/proc/self/maps")
loaded = {line.split()[-1] for line in maps.read_text().splitlines() if "/" in line} if maps.exists() else set()
loaded = {path for path in loaded if ".libs/" not in path}  # what a wheel brings along (Pillow has an X client of its own) is not the machine's
found = sorted(path for path in loaded if GRAPHICS.search(os.path.basename(path)))
print(covered, asked, found)
"""


def test_renders_where_no_graphics_library_can_be_loaded(tmp_path):
    path = tmp_path / "out.png"
    done = subprocess.run([sys.executable, "-c", _CHILD, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    covered, _, rest = done.stdout.partition(" ")
    assert int(covered) > 96 * 64 // 4
    assert rest == "[] []\n", "libraries or modules asked for, and graphics libraries in the process"
    assert path.stat().st_size > 1000
