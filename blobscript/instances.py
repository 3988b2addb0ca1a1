"""Kernels as values: the built-in ones, and those of the script, proved once for each set of arguments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from blobscript import ir, syntax, typed
from blobscript.diagnostics import Diagnostic, Label, has_errors
from blobscript.formulas import Formula, lambda_of
from blobscript.makers import MAKERS
from blobscript.proof import prove
from blobscript.resolve import Definition
from blobscript.runtime import POISON, AbsorbedError, Compiling, Frame, Run, State
from blobscript.shown import show
from blobscript.values import Context

__all__ = ["Instances"]


def _plain(name: str) -> Callable[[Context], ir.Kernel]:
    kernel = ir.Kernel(name)
    return lambda context: kernel


@dataclass(slots=True, eq=False)
class Instances:
    """`families`: the kernels of the script; `proved`: what was found out for (definition, arguments)."""

    families: Mapping[Definition, typed.KernelFamily]
    state: State
    proved: dict[tuple[Definition, tuple[tuple[str, Any], ...]], Any] = field(
        default_factory=dict[tuple[Definition, tuple[tuple[str, Any], ...]], Any]
    )
    _formulas: dict[Definition, dict[str, Formula]] = field(default_factory=dict[Definition, dict[str, Formula]])
    _made: dict[typed.FormulaFunction, Formula] = field(default_factory=dict[typed.FormulaFunction, Formula])
    built_in: Mapping[str, Callable[..., ir.Kernel]] = field(
        default_factory=lambda: (
            {name: _plain(name) for name in ("soft2", "soft3", "wyvill", "metaball")}
            | {name: MAKERS[name] for name in ("gauss", "gauss_c1")}
        )
    )

    def maker(self, compiler: Compiling, definition: Definition, arguments: list[tuple[str, Run]]) -> Run:
        """The kernel with these arguments, the defaults for the others."""
        family = self.families[definition]
        given = dict(arguments)
        slots = [
            (p.name, given.get(p.name) or (compiler.expr(p.default) if p.default else None)) for p in family.parameters
        ]
        constants = [(name, compiler.expr(value)) for name, value in family.constants]
        if definition not in self._formulas:
            self._formulas[definition] = {name: self._formula(compiler, one) for name, one in family.formulas}

        def run(frame: Frame) -> ir.Kernel:
            own: list[Any] = [None]  # the slot of the variable: defaults may use earlier parameters
            values: list[tuple[str, Any]] = []
            for name, value in slots:
                assert value is not None
                made = value(frame) if name in given else value(own)
                own.append(made)
                values.append((name, made))
            values += [(name, value(frame)) for name, value in constants]
            return self._instance(family, tuple(values))

        return run

    def _formula(self, compiler: Compiling, function: typed.FormulaFunction) -> Formula:
        """A function with the values that its body uses, which are known by now; a POISON one is reported already."""
        if function not in self._made:
            node = function.definition.node
            own = lambda_of(node.value) if isinstance(node, syntax.Let) else node
            assert isinstance(own, (syntax.Fn, syntax.Lambda))
            self._made[function] = Formula(
                function.definition.name,
                own.parameters,
                own.statements if isinstance(own, syntax.Fn) else (),
                own.body,
                function.definition.recursive,
                {name: compiler.expr(value)([]) for name, value in function.constants},
                {name: self._formula(compiler, one) for name, one in function.formulas},
            )
        return self._made[function]

    def unused(self) -> list[Definition]:
        """Kernels that no instance was asked of, and that need no arguments."""
        asked = {definition for definition, _ in self.proved}
        return [d for d, f in self.families.items() if d not in asked and all(p.default for p in f.parameters)]

    def _instance(self, family: typed.KernelFamily, values: tuple[tuple[str, Any], ...]) -> ir.Kernel:
        key = (family.definition, values)
        if key not in self.proved:
            self.proved[key] = self._prove(family, values)
        kernel = self.proved[key]
        if kernel is POISON:
            raise AbsorbedError
        return kernel

    def _prove(self, family: typed.KernelFamily, values: tuple[tuple[str, Any], ...]) -> Any:
        node = family.definition.node
        assert isinstance(node, syntax.KernelDecl)
        try:
            kernel, found = prove(
                node.name.text,
                node.parameters,
                node.body,
                dict(values),
                frozenset(family.waivers),
                node.name.span,
                self._formulas[family.definition],
            )
        except OverflowError:  # exact numbers that are too large to be shown
            kernel, found = None, [_too_large(node)]
        self.state.notes += [_with_arguments(d, family, values) for d in found]
        return POISON if kernel is None or has_errors(found) else kernel


def _too_large(node: syntax.KernelDecl) -> Diagnostic:
    message = f"kernel `{node.name.text}` could not be proved: its values go beyond 1e308"
    return Diagnostic("E0506", message, node.body.span, "too large somewhere in 0 <= r <= 1")


def _with_arguments(found: Diagnostic, family: typed.KernelFamily, values: tuple[tuple[str, Any], ...]) -> Diagnostic:
    """Which instance it is about, where there can be several."""
    if not family.parameters:
        return found
    kinds = {p.name: p.type for p in family.parameters}
    told = ", ".join([f"{name} = {show(value, kinds[name])}" for name, value in values if name in kinds])
    return replace(found, labels=(*found.labels, Label(family.definition.name_span, f"with {told}")))
