"""The command line: in process for what it does, as a process for what surrounds it."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from luxel import Picture, __version__, frame, load
from luxel.cli import main
from luxel.io.images import read_image, write_png

COMMANDS = ["demo", "render", "bake", "form-factors", "info", "diff", "filter", "optimize", "study"]
CUBE = """\
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8
"""


@pytest.fixture
def cube(tmp_path):
    path = tmp_path / "cube.obj"
    path.write_text(CUBE)
    return path


def luxel(*words, **options):
    command = [sys.executable, "-m", "luxel", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


def error_of(capsys, *words):
    """The one line on stderr of a command that must fail with exit code 2."""
    code = main([str(word) for word in words])
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    assert err.startswith("luxel: error: ")
    assert err.count("\n") == 1
    return err


# Help


def test_help_names_all_commands(capsys):
    for words in (["--help"], ["-h"], []):
        assert main(words) == 0
        out, err = capsys.readouterr()
        assert all(f"  {name}  " in out for name in COMMANDS)
        assert err == ""


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_an_example(name, capsys):
    assert main([name, "--help"]) == 0
    assert f"Example:\n  luxel {name}" in capsys.readouterr().out


def test_help_imports_nothing_heavy():
    code = (
        "import sys, luxel.cli; luxel.cli.main(['--help']); luxel.cli.main(['render', '--help']);"
        "print(sorted({'numba', 'numpy', 'scipy', 'trimesh', 'rich', 'PIL'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "[]\n"


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"luxel {__version__}\n"


def test_module_and_script_are_the_same():
    assert luxel("--version").stdout == f"luxel {__version__}\n"


# Errors


def test_a_mistyped_command_is_suggested(capsys):
    assert "Did you mean 'render'?" in error_of(capsys, "rendr", "a.obj")


def test_a_mistyped_option_is_suggested(capsys):
    assert "--exposure" in error_of(capsys, "render", "a.obj", "-o", "a.png", "--expsure", "1")


def test_wrong_words_say_where_to_look(capsys):
    assert error_of(capsys, "render").endswith("(luxel render --help shows what there is)\n")
    assert error_of(capsys, "render", "a.obj", "--azimuth").endswith("(luxel render --help shows what there is)\n")
    assert error_of(capsys, "help").endswith("(luxel --help shows what there is)\n")
    assert error_of(capsys, "diff", "a", "b", "c").endswith("(luxel diff --help shows what there is)\n")


def test_a_mistyped_file_is_suggested(capsys, cube, tmp_path):
    write_png(tmp_path / "before.png", np.zeros((2, 2, 3), np.uint8))
    assert f"did you mean {cube}?" in error_of(capsys, "render", tmp_path / "cub.obj", "-o", tmp_path / "a.png")
    assert f"did you mean {tmp_path / 'before.png'}?" in error_of(capsys, "diff", tmp_path / "befor.png", tmp_path / "before.png")
    assert "there is no folder" in error_of(capsys, "info", tmp_path / "models" / "cube.obj")


@pytest.mark.parametrize("name", ["a.obj", "a.glb", "a.gltf", "a.ply", "a.stl", "a.off"])
def test_empty_files_and_folders_are_said(capsys, tmp_path, name):
    (tmp_path / name).touch()
    assert "the file is empty" in error_of(capsys, "info", tmp_path / name)
    (tmp_path / f"folder-{name}").mkdir()
    assert "a folder without model files" in error_of(capsys, "info", tmp_path / f"folder-{name}")
    assert f"{name}: cannot read: the file is empty" in error_of(capsys, "info", tmp_path)  # the only model in the folder


def test_more_memory_than_there_is(capsys, cube, tmp_path, monkeypatch):
    def full(*_, **__):
        raise MemoryError("Unable to allocate 9 EiB")

    monkeypatch.setattr("luxel.raster.render.render_prepared", full)
    err = error_of(capsys, "render", cube, "-o", tmp_path / "a.npz", "--size", "32", "--outputs", "color,depth")
    assert "--size 32x32: not enough memory for color, depth" in err
    assert ".png" in err
    assert main(["demo", "-o", str(tmp_path / "a.png"), "--scene", "two-triangles"]) == 1
    assert capsys.readouterr().err == "luxel: error: not enough memory: Unable to allocate 9 EiB\n"
    assert os.listdir(tmp_path) == ["cube.obj"]


def test_what_is_missing_is_named(capsys, tmp_path):
    assert "FILE" in error_of(capsys, "render")
    assert "no-such.obj" in error_of(capsys, "render", "no-such.obj", "-o", tmp_path / "a.png")
    assert "no-such.glb" in error_of(capsys, "info", "no-such.glb")
    assert "no-such.png" in error_of(capsys, "diff", "no-such.png", "no-such.png")


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--size", "12by3"),
        ("--samples", "3"),
        ("--samples", "many"),
        ("--size", "2000000x8"),
        ("--exposure", "65"),
        ("--exposure", "bright"),
        ("--azimuth", "north"),
        ("--turntable", "0"),
        ("--ssaa", "9"),
        ("--threads", "many"),
        ("--previous", "azimut=3"),
        ("--previous", "azimuth=3"),
        ("--outputs", "motion"),
        ("--filter", "bx"),
        ("--shading", "toon"),
        ("--background", "blurple"),
        ("--cull", "front"),
        ("--outputs", "colour"),
        ("--fov", "200"),
        ("--azimuth", "nan"),
        ("--elevation", "91"),
        ("--distance", "0"),
        ("--crease-angle", "-3"),
        ("--eye", "1,2"),
        ("--ssaa", "0"),
        ("--threads", "0"),
        ("--pattern", "spiral"),
    ],
)
def test_wrong_values_name_the_option(capsys, cube, tmp_path, option, value):
    err = error_of(capsys, "render", cube, "-o", tmp_path / "a.npz", option, value)
    assert err.startswith(f"luxel: error: {option}")
    assert "expected" in err or "needs" in err
    assert os.listdir(tmp_path) == ["cube.obj"]


def test_output_is_checked_before_the_work(capsys, tmp_path):
    assert "no folder" in error_of(capsys, "render", "no-such.obj", "-o", tmp_path / "no" / "a.png")
    assert "--output" in error_of(capsys, "render", "no-such.obj", "-o", "a.tga")
    assert ".exr or .npz" in error_of(capsys, "render", "no-such.obj", "-o", "a.png", "--outputs", "color,depth")


def test_the_unexpected_is_one_line_and_a_hint(capsys, monkeypatch, tmp_path):
    write_png(tmp_path / "a.png", np.zeros((2, 2, 3), np.uint8))
    monkeypatch.setattr("luxel.filter.metrics.rmse", lambda a, b: 1 / 0)
    words = ["diff", str(tmp_path / "a.png"), str(tmp_path / "a.png")]
    assert main(words) == 1
    err = capsys.readouterr().err
    assert err == "luxel: error: unexpected ZeroDivisionError: division by zero (--traceback shows where)\n"
    assert main([*words, "--traceback"]) == 1
    assert "Traceback (most recent call last)" in capsys.readouterr().err


def test_warnings_are_one_line_each_and_quiet_hides_them(capsys, cube):
    cube.write_text("mtllib nowhere.mtl\nusemtl a\n" + CUBE)
    assert main(["info", str(cube)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines
    assert all(line.startswith("luxel: warning: ") for line in lines)
    assert main(["info", "-q", str(cube)]) == 0
    assert capsys.readouterr() == ("", "")


# diff


@pytest.fixture
def pictures(tmp_path):
    a = np.full((40, 50, 3), 100, np.uint8)
    b = a.copy()
    b[10, 20] = 151, 100, 100
    write_png(tmp_path / "a.png", a)
    write_png(tmp_path / "b.png", b)
    return str(tmp_path / "a.png"), str(tmp_path / "b.png")


def test_diff_of_equal_pictures(capsys, pictures):
    assert main(["diff", pictures[0], pictures[0]]) == 0
    assert "equal" in capsys.readouterr().out
    assert main(["diff", pictures[0], pictures[0], "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["same"], data["rmse"], data["psnr"], data["ssim"]) == (True, 0, None, 1)


def test_diff_of_different_pictures(capsys, pictures, tmp_path):
    picture = tmp_path / "d.png"
    assert main(["diff", *pictures, "--output", str(picture), "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    rmse = 0.2 / np.sqrt(40 * 50 * 3)
    assert data["rmse"] == pytest.approx(rmse)
    assert data["psnr"] == pytest.approx(-20 * np.log10(rmse))
    assert data["max_difference"] == pytest.approx(0.2)
    assert data["differing_pixels"] == 1
    shown = read_image(picture)
    assert shown[10, 20].tolist() == [255, 255, 255]
    assert shown.sum() == 3 * 255
    assert main(["diff", *pictures]) == 1
    assert "differing pixels    1 of 2,000" in capsys.readouterr().out


def test_diff_within_a_threshold(capsys, pictures):
    assert main(["diff", *pictures, "--max-rmse", "0.01"]) == 0
    assert main(["diff", *pictures, "--max-rmse", "0.001", "-q"]) == 1
    capsys.readouterr()
    assert "--max-rmse" in error_of(capsys, "diff", *pictures, "--max-rmse", "-1")


def test_diff_with_and_without_alpha(capsys, pictures, tmp_path):
    opaque = np.full((40, 50, 4), (100, 100, 100, 255), np.uint8)
    write_png(tmp_path / "rgba.png", opaque)
    write_png(tmp_path / "grey.png", opaque[..., :1])
    assert main(["diff", pictures[0], str(tmp_path / "rgba.png")]) == 0
    assert main(["diff", pictures[0], str(tmp_path / "grey.png")]) == 0


def test_diff_of_pictures_that_hold_nan_and_infinity(capsys, tmp_path, monkeypatch):
    plain = np.full((8, 8, 4), 0.5, np.float32)
    odd = plain.copy()
    odd[2, 3, 0], odd[4, 4, 1] = np.nan, np.inf
    monkeypatch.chdir(tmp_path)
    Picture(linear=plain).save("plain.exr")
    Picture(linear=odd).save("odd.exr")
    Picture(linear=odd).save("again.exr")
    assert main(["diff", "odd.exr", "again.exr", "--json"]) == 0
    said = capsys.readouterr()
    data = json.loads(said.out)
    assert (data["same"], data["rmse"], data["ssim"], data["differing_pixels"]) == (True, 0, 1, 0)
    assert said.err.count("\n") == 1
    assert "2 pixels hold NaN or infinity" in said.err
    assert main(["diff", "plain.exr", "odd.exr", "--max-rmse", "9", "--output", "d.png", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert (data["same"], data["rmse"], data["max_difference"], data["differing_pixels"]) == (False, 0, 0, 2)
    shown = read_image(tmp_path / "d.png")
    assert sorted(map(tuple, np.argwhere(shown.any(-1)).tolist())) == [(2, 3), (4, 4)]


def test_diff_of_two_sizes_is_an_error(capsys, pictures, tmp_path):
    write_png(tmp_path / "c.png", np.zeros((4, 4, 3), np.uint8))
    err = error_of(capsys, "diff", pictures[0], tmp_path / "c.png")
    assert "50x40" in err
    assert "4x4" in err


# info


def test_info_for_people(capsys, cube):
    assert main(["info", str(cube)]) == 0
    out = capsys.readouterr().out
    assert "12 triangles" in out
    assert "1 x 1 x 1 m" in out
    assert "Nothing odd." in out


def test_info_for_programs(capsys, cube):
    assert main(["info", str(cube), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["triangles"] == 12
    assert data["bounds"] == [[0, 0, 0], [1, 1, 1]]
    assert data["meshes"][0]["closed"] is True
    assert data["oddities"] == []


def test_info_says_what_is_odd(capsys, cube):
    cube.write_text(CUBE.replace("f 4 1 5 8\n", ""))
    assert main(["info", str(cube)]) == 0
    assert "4 open edges" in capsys.readouterr().out


@pytest.mark.parametrize(("terminal", "columns", "whole"), [("", "100", True), ("1", "100", False), ("1", "40", True)])
def test_info_folds_long_names_in_a_terminal_with_room(capsys, cube, monkeypatch, terminal, columns, whole):
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setenv("FORCE_COLOR", terminal)  # as if it were one
    name = "a-mesh-with-a-name-of-many-words-" * 4
    cube.write_text(f"o {name}\n" + CUBE * 1000)
    assert main(["info", str(cube)]) == 0
    table = capsys.readouterr().out.split("Meshes")[1].split("Odd")[0]
    assert (name in table) == whole
    assert "12,000" in table  # numbers are never folded


def test_info_of_nothing(capsys, tmp_path):
    (tmp_path / "points.obj").write_text("v 0 0 0\n")
    assert main(["info", str(tmp_path / "points.obj")]) == 0
    assert "\n  no triangles  (there is nothing to draw)" in capsys.readouterr().out


def test_info_says_what_lies_at_the_same_place(capsys, cube):
    cube.write_text("o one\n" + CUBE + "o two\n" + CUBE)
    assert main(["info", str(cube)]) == 0
    assert "1 coincident objects in one, two" in capsys.readouterr().out


def test_a_reader_that_goes_away_is_no_error(cube):
    code = f"import sys; from luxel.cli import main; sys.exit(main(['info', {str(cube)!r}, '--json']))"
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-c", code], stdout=write, stderr=subprocess.PIPE, text=True, timeout=60)
    os.close(write)
    assert done.returncode == 1
    assert done.stderr == ""


# render and demo


def test_render_writes_a_picture(capsys, cube, tmp_path):
    out = tmp_path / "cube.png"
    assert main(["render", str(cube), "-o", str(out), "--size", "64x48"]) == 0
    said = capsys.readouterr()
    assert said.out.startswith(f"{out}  (64x48, 12 triangles")
    picture = read_image(out)
    assert picture.shape == (48, 64, 4)
    covered = (picture[..., 3] > 0).mean()
    assert 0.2 < covered < 0.9  # framed: neither lost nor cut
    assert not picture[[0, -1]][..., 3].any()
    assert not picture[:, [0, -1]][..., 3].any()


def test_render_json_is_all_there_is_on_stdout(capsys, cube, tmp_path):
    out = tmp_path / "cube.npz"
    words = ["render", str(cube), "-o", str(out), "--size", "32", "--outputs", "color,depth,triangle", "--json"]
    assert main(words) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["output"] == [str(out)]
    assert data["size"] == [32, 32]
    assert data["triangles"] == 12
    with np.load(out) as arrays:
        assert set(arrays) == {"color", "depth", "triangle"}
        assert np.isfinite(arrays["depth"]).sum() == (arrays["triangle"] >= 0).sum() > 100


def test_render_quietly(capsys, cube, tmp_path):
    assert main(["render", str(cube), "-o", str(tmp_path / "a.png"), "--size", "16", "-q"]) == 0
    assert capsys.readouterr() == ("", "")


def test_a_file_without_triangles_is_said(capsys, tmp_path):
    points = tmp_path / "points.obj"
    points.write_text("v 0 0 0\n")
    assert main(["render", str(points), "-o", str(tmp_path / "a.png"), "--size", "8"]) == 0
    assert "no triangles: the picture is empty" in capsys.readouterr().err


def test_turntable_numbers_its_files(capsys, cube, tmp_path):
    assert main(["render", str(cube), "-o", str(tmp_path / "t.png"), "--size", "24", "--turntable", "3", "--json"]) == 0
    expected = [str(tmp_path / f"t_{i:03}.png") for i in range(3)]
    assert json.loads(capsys.readouterr().out)["output"] == expected
    a, b, c = (read_image(path) for path in expected)
    assert (a != b).any()
    assert (b != c).any()


def test_motion_is_that_of_the_picture_before(cube, tmp_path):
    """What one picture shows at a pixel, the other shows where its motion says."""
    path = tmp_path / "motion.npz"
    words = ["-o", str(path), "--size", "64", "--samples", "1", "--outputs", "position,motion", "-q"]
    assert main(["render", str(cube), *words, "--azimuth", "10", "--previous", "azimuth=12"]) == 0
    with np.load(path) as arrays:
        position, motion = arrays["position"].astype(float), arrays["motion"]
    seen = np.abs(motion).sum(-1) > 0
    assert seen.sum() > 500
    corners = np.column_stack([position[seen], np.ones(seen.sum())])
    clip = corners @ frame(load(cube), np.radians(12), size=(64, 64)).clip_from_world((64, 64)).T
    before = 32 + 32 * clip[:, :2] / clip[:, 3:] * [1, -1]
    now = np.argwhere(seen)[:, ::-1] + 0.5
    assert np.abs(motion[seen] - (now - before)).max() < 1e-3


def test_motion_in_a_turntable(cube, tmp_path):
    words = ["--size", "24", "--outputs", "motion", "--turntable", "3", "-q"]
    assert main(["render", str(cube), "-o", str(tmp_path / "t.npz"), *words]) == 0
    for i in range(3):
        with np.load(tmp_path / f"t_{i:03}.npz") as arrays:
            assert np.abs(arrays["motion"]).max() > 1


def test_options_reach_the_renderer(cube, tmp_path):
    def drawn(*words):
        path = tmp_path / "x.png"
        assert main(["render", str(cube), "-o", str(path), "--size", "32", "-q", *words]) == 0
        return read_image(path).astype(int)

    plain = drawn()
    assert (drawn("--background", "#ff0000")[0, 0] == [255, 0, 0, 255]).all()
    assert drawn("--exposure", "-2")[16, 16, :3].sum() < plain[16, 16, :3].sum()
    assert (drawn("--shading", "unlit")[16, 16] != plain[16, 16]).any()
    assert (drawn("--azimuth", "200") != plain).any()
    assert set(np.unique(drawn("--samples", "1")[..., 3])) == {0, 255}
    assert len(np.unique(drawn("--samples", "16")[..., 3])) > 4
    assert (drawn("--filter", "gaussian") != plain).any()
    assert (drawn("--threads", "1") == plain).all()


def test_demo(capsys, tmp_path):
    out = tmp_path / "demo.png"
    assert main(["demo", "-o", str(out), "--size", "96x54", "--scene", "cornell-box"]) == 0
    assert capsys.readouterr().out.startswith(str(out))
    picture = read_image(out)
    assert picture.shape[:2] == (54, 96)
    red, green = picture[27, 30, :3].astype(int), picture[27, 66, :3].astype(int)
    assert red[0] > 2 * red[1]  # the red wall is on the left
    assert green[1] > 2 * green[0] or green[1] > green[0] + 20
    assert "did you mean room" in error_of(capsys, "demo", "--scene", "rom")


def test_the_first_run_says_that_it_compiles(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    out = tmp_path / "a.png"
    words = ["demo", "--scene", "two-triangles", "--size", "16", "-o", out]
    first, second = luxel(*words, env=environment), luxel(*words, env=environment)
    assert first.returncode == second.returncode == 0
    assert first.stderr.count("compiling") == 1
    assert second.stderr == ""


INTERRUPTED_IN_DISGUISE = """
import os, signal, sys
import luxel.cli, luxel.cli.app, luxel.errors

def command():
    try:
        os.kill(os.getpid(), signal.SIGINT)
        import time; time.sleep(5)
    except KeyboardInterrupt as error:
        raise DISGUISE from error

luxel.cli.app.command = command
sys.exit(luxel.cli.main())
"""


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize(
    "disguise", ["RuntimeError('lost')", "luxel.errors.ExtraMissingError('xatlas', 'bake', 'baking')", "OSError(5, 'lost')", "MemoryError()"]
)
def test_an_interrupt_that_became_another_exception_is_one(disguise):
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_IN_DISGUISE.replace("DISGUISE", disguise)], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "luxel: interrupted\n")


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize(("number", "code", "told"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "interrupted by SIGTERM")])
def test_interrupt_leaves_no_file_behind(tmp_path, number, code, told):
    command = [sys.executable, "-m", "luxel", "demo", "--size", "6000x6000", "-o", str(tmp_path / "big.png")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    time.sleep(1.5)
    process.send_signal(number)
    out, err = process.communicate(timeout=120)
    assert process.returncode == code
    assert err.endswith(f"luxel: {told}\n")
    assert out == ""
    assert os.listdir(tmp_path) == []
