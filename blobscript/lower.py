"""Evaluates a typed program: the fourth pass, from types to the values that make the scene.

Definitions are evaluated in the order of need, then the items of the main script in the order of
the file; what stands there as surfaces, lights and so on is handed to `assemble`. A definition
that fails is reported once; what needs it is left out without a further word, and everything else
is still evaluated, so that one run reports all there is to report.

Time and memory are bounded by the budget (`runtime`); a script reads files below its folder only
and does nothing else.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

# `looks` calls it late, since it stands above the makers; loaded here, it counts as start-up, not as compiling.
import blobscript.follow  # noqa: F401  # pyright: ignore[reportUnusedImport]
from blobscript import ir, syntax, typed
from blobscript.assemble import assemble, misfits
from blobscript.deep import deeply
from blobscript.diagnostics import Diagnostic, Edit, Help, has_errors
from blobscript.evaluate import Compiler
from blobscript.instances import Instances
from blobscript.params import noted, param_value, unknown_params
from blobscript.parts import count_parts
from blobscript.resolve import told
from blobscript.runtime import DEFAULT_BUDGET, POISON, AbsorbedError, FailureError, Frame, State
from blobscript.source import Span
from blobscript.types import describe
from blobscript.values import Blob, Changed, Combine, Context, Surface

__all__ = ["lower"]

Placed = tuple[object, "str | None", "Span | None"]

#: 10 million blobs in all; at some 300 bytes each, more would not fit most machines.
_PARTS_PER_STEP = 5

_TRANSFORMS = ("move", "rotate", "scale", "mirror", "apply")


def lower(
    program: typed.Program,
    params: Mapping[str, object] | None = None,
    budget: int | None = None,
    *,
    time: float = 0.0,
    phase: float = 0.0,
) -> tuple[ir.Scene | None, list[Diagnostic]]:
    """The scene of a program without errors, and what evaluating it has to say.

    params: values for the parameters of the main script. time, phase: the moment of a film.
    """
    source = program.main.source
    state = State(Context(Span(source, 0, 0), source.folder), budget or DEFAULT_BUDGET, time, phase)
    run = _Run(program, state, params or {})
    deeply(run.everything)
    if has_errors(run.found):
        return None, told([*run.found, *misfits(run.placed, state.context)], program.modules)
    too_many = _too_many(run.placed, state)
    if too_many is not None:
        return None, told([*run.found, too_many], program.modules)
    unplaced = [(u.name, describe(u.type), u.span) for u in program.unplaced]
    scene, more = assemble(
        run.placed,
        state.context,
        source=source,
        params=tuple(run.infos),
        unplaced=unplaced,
        sources=[(s.path, hashlib.sha256(s.text.encode()).hexdigest()) for s in program.sources],
        limit=max(state.budget, DEFAULT_BUDGET),
    )
    lonely = _lonely_fields(run.placed) if scene is not None else ()
    return scene, told([*run.found, *more, *lonely], program.modules)


@dataclass(slots=True, eq=False)
class _Run:
    program: typed.Program
    state: State
    given: Mapping[str, object]
    placed: list[Placed] = field(default_factory=list[Placed])
    infos: list[ir.ParamInfo] = field(default_factory=list[ir.ParamInfo])
    found: list[Diagnostic] = field(default_factory=list[Diagnostic])

    def everything(self) -> None:
        families = {d.definition: d for d in self.program.definitions if isinstance(d, typed.KernelFamily)}
        compiler = Compiler(self.program, self.state, Instances(families, self.state))
        self.found += unknown_params(self.program, self.given)
        for definition in self.program.definitions:
            if not isinstance(definition, typed.KernelFamily):
                cell = compiler.cells.setdefault(definition.definition, [POISON])
                cell[0] = self._guarded(lambda d=definition: self._value(compiler, d))
        for item in self.program.items:
            self._guarded(lambda i=item: self._place(compiler, i))
        for definition in compiler.instances.unused():
            if definition.module is self.program.main:
                self._guarded(lambda d=definition: compiler.instances.maker(compiler, d, [])([]))

    def _guarded(self, work: Callable[[], Any]) -> Any:
        """The result, or POISON after a mistake, which is reported."""
        self.state.depth = 0
        if self.state.steps < 0:  # nothing is left of the budget
            return POISON
        try:
            return work()
        except AbsorbedError:
            return POISON
        except FailureError as failure:
            self.found += failure.all_finished()
            return POISON
        except (RecursionError, MemoryError):
            self.found.append(_out_of_room(self.program))
            return POISON
        finally:
            self.found += self.state.notes
            self.state.notes.clear()

    # ---- definitions ----------------------------------------------------------------------

    def _value(self, compiler: Compiler, definition: typed.Value | typed.FileParam) -> Any:
        frame: Frame = [None] * definition.size
        if isinstance(definition, typed.Value):
            return compiler.expr(definition.value)(frame)
        own = definition.definition.module is self.program.main
        info = self._param(compiler, definition, frame, self.given if own else {})
        if own:
            self.infos.append(noted(info, definition.type))
        return info.value

    def _param(
        self, compiler: Compiler, param: typed.FileParam, frame: Frame, given: Mapping[str, object]
    ) -> ir.ParamInfo:
        default = compiler.expr(param.default)(frame)
        limits, choices, step = None, None, None
        if param.allowed is not None:
            limits = (compiler.expr(param.allowed.lo)(frame), compiler.expr(param.allowed.hi)(frame))
            if limits[0] > limits[1]:
                raise FailureError(_empty_range(param))
        if param.choices is not None:
            choices = list(compiler.expr(param.choices)(frame))
        if param.step is not None:
            step = compiler.expr(param.step)(frame)
        return param_value(param, default, limits, choices, step, given, self.program.main.source.path)

    # ---- the scene ------------------------------------------------------------------------

    def _place(self, compiler: Compiler, item: typed.Placed) -> None:
        emit = compiler.elements((item.element,), lambda element: _placing(compiler, element))
        emit([None] * item.size, self.placed)


def _placing(compiler: Compiler, element: typed.Item) -> Callable[[Frame, list[Any]], None]:
    value, name, span = compiler.expr(element.value), _let_name(element.value), element.span

    def emit(frame: Frame, out: list[Any]) -> None:
        out.append((value(frame), name, span))

    return emit


def _let_name(node: typed.Expr) -> str | None:
    """The name of what is placed, also after transforms: `gecko.rotate(y = 20deg)` is the gecko."""
    while isinstance(node, typed.CallBuiltin) and node.name in _TRANSFORMS:
        node = dict(node.arguments)["it"]
    if isinstance(node, typed.Global) and isinstance(node.definition.node, syntax.Let):
        return node.definition.name
    return None


def _lonely_fields(placed: Sequence[Placed]) -> Iterator[Diagnostic]:
    """Fields on lines of their own, each place once: nothing of them is seen."""
    seen: set[Span] = set()
    for value, _, span in placed:
        if isinstance(value, (Blob, Combine, Changed)) and span is not None and span not in seen:
            seen.add(span)
            before = Span(span.source, span.start, span.start)
            yield Diagnostic(
                "W0402",
                "this field is in no surface, so it is not seen",
                span,
                "a density, not a surface",
                helps=(Help("put it into a surface", (Edit(before, "surface { "), Edit(span.at_end, " }"))),),
            )


# ---- what goes wrong ------------------------------------------------------------------------


def _too_many(placed: Sequence[Placed], state: State) -> Diagnostic | None:
    """One field in very many surfaces would take all memory there is."""
    surfaces = [value for value, _, _ in placed if isinstance(value, Surface)]
    most = _PARTS_PER_STEP * max(state.budget, DEFAULT_BUDGET)
    count = count_parts(surfaces)
    if count <= most:
        return None
    span = next((span for value, _, span in reversed(placed) if isinstance(value, Surface)), None)
    return Diagnostic(
        "E0901",
        f"the surfaces of this scene have {count} blobs in all, but {most} are the limit",
        span,
        "too many with this one",
        helps=(Help("use fewer surfaces of the same large field, or raise the limit with --budget"),),
    )


def _empty_range(param: typed.FileParam) -> Diagnostic:
    assert param.allowed is not None
    return Diagnostic(
        "E0405",
        f"the range of `{param.definition.name}` is empty: it ends before it starts",
        param.allowed.span,
        "from the smaller to the larger",
    )


def _out_of_room(program: typed.Program) -> Diagnostic:
    source = program.main.source
    return Diagnostic(
        "E0901",
        "this script is nested too deeply, or makes more than the memory holds",
        Span(source, 0, 0),
        helps=(Help("break long expressions into several definitions"),),
    )
