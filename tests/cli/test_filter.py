"""luxel filter: what it writes is what the library gives, and what is wrong is said in one line."""

import json

import numpy as np
import pytest

from luxel.cli import main
from luxel.filter import lowpass
from luxel.io.images import read_image, write_png


@pytest.fixture
def picture(tmp_path, monkeypatch):
    """A picture in.png in the folder that commands run in."""
    monkeypatch.chdir(tmp_path)
    image = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    write_png("in.png", image)
    return image


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ("--gaussian 2.5", {"gaussian": 2.5}),
        ("--butterworth .2 --order 4", {"butterworth": (0.2, 4)}),
        ("--butterworth .2", {"butterworth": (0.2, 2)}),
        ("--ideal .25 --border wrap", {"ideal": 0.25, "border": "wrap"}),
        ("--gaussian 1 --border constant --value .5 --method tiles --threads 1", {"gaussian": 1, "border": "constant", "value": 0.5}),
    ],
)
@pytest.mark.parametrize("memory", ["2048", "1"])
def test_filters(picture, words, options, memory):
    assert main(["filter", "in.png", "-o", "out.png", "-q", "--memory", memory, *words.split()]) == 0
    assert np.abs(read_image("out.png").astype(int) - lowpass(picture, **options)).max() <= 1


def test_large_pictures_go_in_bands(tmp_path, monkeypatch, capsys):
    """1 MB of memory, 9 MB of numbers."""
    monkeypatch.chdir(tmp_path)
    image = np.random.default_rng(2).random((1500, 500, 3)).astype(np.float32)
    np.save("in.npy", image)
    assert main(["filter", "in.npy", "-o", "out.npy", "--gaussian", "3", "--memory", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["in_memory"] is False
    assert np.abs(np.load("out.npy") - lowpass(image, gaussian=3)).max() < 1e-6
    assert main(["filter", "in.npy", "--spectrum", "s.png", "--gaussian", "3", "-o", "x.npy", "--memory", "1"]) == 2
    assert "--spectrum: 500x1500 is more than --memory holds" in capsys.readouterr().err
    assert not (tmp_path / "x.npy").exists()


def test_kernels_and_spectra(picture, capsys):
    write_png("k.png", np.full((3, 5), 200, np.uint8))
    assert main(["filter", "in.png", "-o", "out.png", "--kernel", "k.png", "--spectrum", "s.png", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["output"] == ["out.png", "s.png"]
    assert data["size"] == [64, 48]
    assert np.abs(read_image("out.png").astype(int) - lowpass(picture, kernel=np.full((3, 5), 1 / 15))).max() <= 1
    assert read_image("s.png").shape == (48, 2 * 64 + 4, 1)
    assert main(["filter", "in.png", "--spectrum", "s.png"]) == 0
    assert read_image("s.png").shape == (48, 64, 1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("in.png -o out.png", "expected one of --gaussian"),
        ("in.png --gaussian 2", "nothing would be written"),
        ("in.png -o out.png --gaussian 2 --ideal .2", "--gaussian and --ideal: one of them"),
        ("in.png -o out.png --gaussian 2 --order 3", "--order is for --butterworth"),
        ("in.png -o out.png --gaussian two", "--gaussian: expected a number of pixels, got 'two'"),
        ("in.png -o out.png --gaussian -1", "standard deviation above 0"),
        ("in.png -o out.png --ideal 3", "cycles per pixel above 0"),
        ("in.png -o out.png --butterworth .2 --order 0", "order: expected"),
        ("in.png -o out.png --gaussian 2 --border round", "--border: expected one of"),
        ("in.png -o out.png --gaussian 2 --method fast", "--method: expected one of"),
        ("in.png -o out.png --ideal .2 --method tiles", "tiles cannot apply this filter"),
        ("in.png -o out.gif --gaussian 2", "--output: expected a file name"),
        ("in.png -o out.png --gaussian 2 --spectrum s.jpg", "--spectrum: expected a file name"),
        ("none.png -o out.png --gaussian 2", "none.png: cannot read"),
        ("text.png -o out.png --gaussian 2", "text.png: not a picture"),
        ("in.png -o out.png --kernel none.png", "none.png: cannot read"),
        ("many.npy -o out.png --gaussian 1", "got (4, 4, 16)"),
        ("nan.npy -o out.npy --gaussian 1", "got nan at row 1, column 2"),
        ("in.png -o out.png --gaussian 2 --memory 0", "--memory"),
    ],
)
def test_bad_input(picture, capsys, tmp_path, words, message):
    (tmp_path / "text.png").write_text("this is text")
    np.save("many.npy", np.zeros((4, 4, 16)))
    odd = np.zeros((4, 4))
    odd[1, 2] = np.nan
    np.save("nan.npy", odd)
    with np.errstate(invalid="ignore"):
        assert main(["filter", *words.split()]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.splitlines()[-1].startswith("luxel: error: ")
    assert "Traceback" not in error
    assert not list(tmp_path.glob("out.*"))
