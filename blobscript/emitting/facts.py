"""What is known of the tracer's conditions for one scene.

Most of it follows from the data: which enumerators occur in them, and which flags are set. The rest are
expressions that can only be one thing where a need is absent; `ABSENT` names them in the tracer's own words. An
expression that the sources no longer have costs size, and a test tells.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from blobscript.emitting.folding import Facts
from blobscript.emitting.units import Macro, Unit

__all__ = ["ABSENT", "facts_for", "families"]

#: Need -> C expression (behind "name: " in that function alone) -> what it is without the need.
ABSENT: dict[str, dict[str, str]] = {
    "kernel-user": {
        "given.lines": "0",
        "kernel_user_jet(scene, kernel, s)": "((kernel_jet){0.0, 0.0})",
        "packet_point_of(KERNEL_USER, p, f, pieces, t, sum)": "(void)0",
    },
    "meshes": {"index_meshes(index, &builder);": ""},
    "negative-weights": {"w >= 0.0": "1", "!sandwich_cancels(&s->p)": "1"},
    "shapes": {
        "scene->shape &&": "0 &&",
        "scene->shape ?": "0 ?",
        "packet_add: shape < 0": "1",
        "f->pieces >= 0": "0",
        "leaf_distance: if (p)": "if (0)",
        "leaf_range_of: if (!p)": "if (1)",
        "packet_point_of: if (pieces)": "if (0)",
        "given.ranges": "0",
        "s->lines": "0",
    },
    "nodes": {"p->depth == 0": "1", "p->depth": "0"},
    "repeats": {"b->index->repeats": "0"},
    "lanes": {"vector_size(64), aligned(64)": "vector_size(64), aligned(16)", '_Pragma("omp simd")': ""},
    "teams": {
        "b.tree->kind >= 0 && query->search == BLOB_SEARCH_SANDWICH": "0",
        "sum_scratch sum;": "",
        "sum_scratch_free(&scratch->sum);": "",
    },
    "cancel": {"query->cancel": "0"},
    "layers": {"rgba ?": "1 ?", "shade_fully: && rgba": "", "layers &&": "0 &&", "wants_centres(layers)": "0"},
    "times": {
        "const double start = clock_start(job);": "",
        "clock_stop(job, start);": "",
        "seconds ?": "0 ?",
        "shade_tile: if (seconds)": "if (0)",
        "job->timed = seconds != NULL;": "",
        "shade_fully: if (seconds)": "if (0)",
        "shade_plain: if (seconds)": "if (0)",
    },
    "adaptive": {
        "shade_rounds: rounds ?": "0 ?",
        "(uint8_t)(cell_goes_on(job, tile, cell, last) || last < picture->least)": "0",
    },
    "plain": {"plain_enough(picture, query) ?": "0 ?"},
    "queues": {"plain_enough(picture, query) ?": "1 ?"},
    "paint": {"picture->painted": "0", "engine_paint_##SUFFIX": "NULL"},
    "refraction": {"picture->transparent": "0", "through > 0": "0"},
    "chance": {"light_answer: own > 0": "0", "light_points: chance &&": "0 &&", "light_points: && chance": "&& 0"},
    "bounces": {
        "point_bounce(job, point, sharp, first, second);": "",
        "push_children(job, job->first, first);": "",
        "push_children(job, job->second, second);": "",
        "sort_queue: depth == 0": "1",
        "sort_queue: , other[SHADE_QUEUE]": "",
        "job->waiting[depth + 1] >= SHADE_BATCH": "0",
    },
    "fog": {"if (left < 1) fog_add(job, ray, left);": ""},
    "floor": {
        "collect_points: floor < HUGE_VAL": "0",
        "collect_points: gone > 0": "0",
        "collect_points: !(gone < 1)": "0",
    },
}


def families(units: Iterable[Unit]) -> dict[str, list[str]]:
    """First enumerator -> all of its enum, in order."""
    found: dict[str, list[str]] = {}
    for unit in units:
        if unit.kind == "code" and unit.text.split("*/")[-1].lstrip().startswith(("enum {", "enum\n")):
            body = unit.text[unit.text.rindex("{") + 1 : unit.text.rindex("}")]
            names = [part.split("=")[0].split("*/")[-1].strip() for part in body.split(",")]
            names = [name for name in names if name]
            found[names[0]] = names
    return found


def facts_for(
    needs: frozenset[str],
    alive: Mapping[str, Iterable[str]],
    families: Mapping[str, list[str]],
    flags: Mapping[str, str],
    macros: Mapping[str, Macro],
) -> Facts:
    """needs: names of `ABSENT` that are there. alive: first enumerator of an enum -> those that
    occur. flags: expression -> value."""
    known = dict(flags)
    for need, expressions in ABSENT.items():
        if need not in needs:
            known |= expressions
    dead: set[str] = set()
    sole: set[str] = set()
    for first, living in alive.items():
        there = set(living)
        dead |= {name for name in families.get(first, []) if name not in there and not name.endswith("_COUNT")}
        sole |= there if len(there) == 1 else set()
    loops, cases = _kinds(macros)
    return Facts(known, frozenset(dead), frozenset(sole), loops, cases)


def _kinds(macros: Mapping[str, Macro]) -> tuple[frozenset[str], frozenset[str]]:
    """Macros that head a statement, and those that stand for a case."""
    loops: set[str] = set()
    bodies = {name: "".join(t.text for t in macro.body).replace("\\", " ").split() for name, macro in macros.items()}
    for _ in range(2):  # a loop macro may be made of another one
        for name, words in bodies.items():
            inner = [word.split("(")[0] for word in words if not word.startswith("_Pragma")]
            if inner and (inner[0] == "for" or (inner[-1] in loops or words[-1].split("(")[0] in loops)):
                loops.add(name)
    return frozenset(loops), frozenset(name for name, words in bodies.items() if words and words[0] == "case")
