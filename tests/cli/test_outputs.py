"""Output files: what cannot be written is refused before the work, by every verb, in the same words."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from blobscript.cli import main
from blobscript.outputs import WriteError, pending

_SCRIPT = "animate(seconds = 1, fps = 2)\nsurface { ball(radius = 1) }\n"

#: What a verb needs, and an ending that it knows.
_VERBS = [
    ("render scene.blob", ".png"),
    ("animate scene.blob", ".gif"),
    ("mesh scene.blob", ".stl"),
    ("compare scene.blob", ".html"),
    ("report scene.blob", ".html"),
    ("bench scene.blob", ".md"),
    ("stress", ".html"),
    ("plot kernel soft2", ".svg"),
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("scene.blob").write_text(_SCRIPT)
    return tmp_path


@pytest.mark.parametrize(("verb", "ending"), _VERBS)
@pytest.mark.parametrize(
    ("name", "code", "said"),
    [
        ("out.foo", 2, "error[E0803]: cannot write `out.foo`: .foo is no "),
        ("out", 2, "needs an ending that names its format"),
        ("nowhere/out{}", 3, "there is no folder `nowhere`"),
        ("folder{}", 3, "it is a folder"),
        ("pipe{}", 3, "it is not a plain file"),
    ],
)
def test_refused_at_once(verb: str, ending: str, name: str, code: int, said: str, capsys, folder: Path) -> None:
    Path(f"folder{ending}").mkdir()
    os.mkfifo(f"pipe{ending}")
    before = sorted(folder.iterdir())
    assert main([*verb.split(), "-o", name.format(ending)]) == code
    assert said in capsys.readouterr().err
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("verb", ["compile scene.blob --to json", "import-pov scene.pov", "fmt scene.blob"])
def test_a_device_stays_a_device(verb: str, capsys, folder: Path) -> None:
    Path("scene.pov").write_text("blob { threshold 0.5 sphere { 0, 1, 1 } }")
    os.mkfifo("device")
    given = [*verb.split(), *(["-o", "device"] if "fmt" not in verb else [])]
    if "fmt" in verb:
        Path("scene.blob").rename("real.blob")
        Path("scene.blob").symlink_to("real.blob")
    main(given)
    assert Path("device").is_fifo()
    assert Path("scene.blob").is_symlink() == ("fmt" in verb)
    assert not [path for path in folder.iterdir() if path.name.endswith(".part")]


def test_an_interruption_leaves_the_old_file(folder: Path) -> None:
    Path("out.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt), pending("out.txt") as part:
        part.write_text("half")
        raise KeyboardInterrupt
    with pytest.raises(WriteError, match="no space left"), pending("out.txt") as part:
        raise OSError(28, "No space left on device")
    assert Path("out.txt").read_text() == "old"
    assert sorted(path.name for path in folder.iterdir()) == ["out.txt", "scene.blob"]
