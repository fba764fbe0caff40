"""What a name that is not there may have been meant to be."""

import pytest

from luxel.errors import FileError
from luxel.io.files import open_plain


@pytest.mark.parametrize(("there", "asked", "meant"), [
    (["tree.glb"], "room.glb", None), (["tree.glb"], "tre.glb", "tree.glb"), (["cube.mtl", "cube.obj"], "cub.obj", "cube.obj"),
    (["cube.ply"], "cube.stl", "cube.ply"), ([], "cube.stl", None),
])  # fmt: skip
def test_near_names_are_near_without_their_ending(tmp_path, there, asked, meant):
    for name in there:
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(FileError) as told:
        open_plain(tmp_path / asked)
    assert ("did you mean" in str(told.value)) == (meant is not None)
    assert meant is None or str(tmp_path / meant) in str(told.value)
