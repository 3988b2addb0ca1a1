"""`python -m blobscript.stress.make`: certifies the answers of cases that are new or have changed."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

from blobscript import compile as compile_script
from blobscript.stress.cases import Case
from blobscript.stress.catalogue import Expected, all_cases, certify, fingerprint

__all__ = ["main"]


def main() -> None:
    """Writes after each case: certifying all of them takes minutes."""
    path = Path(__file__).parent / "answers.json"
    old: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    new: dict[str, Any] = {}
    for case in all_cases():
        name = f"{case.group}/{case.id}"
        if old.get(name, {}).get("of") != fingerprint(case):
            start = time.perf_counter()
            old[name] = {"of": fingerprint(case), "rays": _rows(case)}
            print(f"{name}: {len(case.rays)} rays in {time.perf_counter() - start:.1f} s", flush=True)
            path.write_text(_text(old), encoding="utf-8")
        new[name] = old[name]
    path.write_text(_text(new), encoding="utf-8")


def _rows(case: Case) -> list[dict[str, Any]]:
    if case.refused:
        return []
    found = certify(case, compile_script(case.script).ir)
    return [
        {name: getattr(e, name) for name in Expected.__slots__} | {"t": e.t if math.isfinite(e.t) else None}
        for e in found
    ]


def _text(answers: dict[str, Any]) -> str:
    """One line for each case and ray."""
    parts: list[str] = []
    for name, entry in answers.items():
        rays = ",\n  ".join(json.dumps(row) for row in entry["rays"])
        parts.append(f'{json.dumps(name)}: {{"of": "{entry["of"]}", "rays": [\n  {rays}]}}')
    return "{\n" + ",\n".join(parts) + "\n}\n"


if __name__ == "__main__":
    main()
