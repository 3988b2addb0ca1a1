"""One-token mutations of all scripts: no crash, no silence, and an error within a line of the mistake."""

from __future__ import annotations

from syntax.mutations import mutants
from syntax.scripts import fits, named, scripts

from blobscript.parse import parse
from blobscript.report import render_all
from blobscript.source import Source

#: Of 300 mutants some are right programs (`x` for `y`): only those that are not count here.
WANTED, SEED = 300, 20


def test_three_hundred_mutants() -> None:
    paths = scripts()
    wrong = near = 0
    far: list[str] = []
    number = 0
    while wrong < WANTED:
        path = paths[number % len(paths)]
        for mutant in mutants(path.read_text(encoding="utf-8"), 5, SEED + number):
            if fits(mutant.text):
                continue
            _, diagnostics = parse(Source("t.blob", mutant.text))
            assert diagnostics, f"silent: {named(path)}:{mutant.line} {mutant.what}"
            assert render_all(diagnostics)
            wrong += 1
            if any(abs(d.line - mutant.line) <= 1 for d in diagnostics):
                near += 1
            else:
                far.append(f"{named(path)}:{mutant.line} {mutant.what}: {[(d.code, d.line) for d in diagnostics]}")
        number += 1
    assert near >= 0.95 * wrong, far


def test_what_fits_has_no_finding_of_the_parser() -> None:
    """The other side: mutants that the bare automaton takes are not called wrong by the parser."""
    for number, path in enumerate(scripts()):
        for mutant in mutants(path.read_text(encoding="utf-8"), 10, SEED + number):
            if fits(mutant.text):
                _, diagnostics = parse(Source("t.blob", mutant.text))
                assert {d.code for d in diagnostics} <= {"E0103", "E0107", "E0108", "E0202"}, mutant
