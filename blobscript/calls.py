"""Calls: what is called, which argument goes to which parameter, and which overload is meant.

A call is checked in three steps: the callee becomes a list of signatures, the arguments are laid
out on the parameters of each (names, order, the trailing block), and their types are matched. With
one signature the arguments are checked one after the other with the parameter's type as a hint, so
a lambda learns its parameter types from what stands before it; with several, the arguments are
checked first and the first signature that fits is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from blobscript import syntax, typed, wording
from blobscript.callables import Parameter, Signature, builtin_signatures
from blobscript.convert import converted
from blobscript.css import CSS_COLORS
from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.inferring import Inferring
from blobscript.names import definition_use, field_type, module_member, module_of, unknown
from blobscript.records import record_type
from blobscript.resolve import Definition, ModuleName, Unresolved
from blobscript.scopes import Scope
from blobscript.signatures import BUILTINS
from blobscript.source import Span
from blobscript.suggest import closest
from blobscript.types import (
    ERROR,
    INT,
    KERNEL,
    NUMBER,
    PRIMITIVES,
    FnOf,
    ListOf,
    OneOf,
    RecordOf,
    Type,
    Variable,
    article,
    closed,
    fits,
    has_error,
    is_open,
    match,
    substitute,
    variables,
)
from blobscript.words import FOREIGN_ARGUMENTS

__all__ = ["call"]


@dataclass(frozen=True, slots=True)
class _Given:
    """An argument as written; `value` is set where it was checked already. `receiver`: the x of x.f()."""

    label: syntax.Name | None
    node: syntax.Expr
    span: Span
    value: typed.Expr | None = None
    receiver: bool = False


@dataclass(slots=True)
class _Layout:
    """Which argument stands for which parameter, and what is wrong with that."""

    signature: Signature
    arguments: dict[str, _Given] = field(default_factory=dict[str, _Given])
    rest: list[_Given] = field(default_factory=list[_Given])
    problems: list[Diagnostic] = field(default_factory=list[Diagnostic])


@dataclass(frozen=True, slots=True)
class _Call:
    """One call on its way through the checks."""

    inference: Inferring
    node: syntax.Call
    scope: Scope
    name: str
    name_span: Span
    given: tuple[_Given, ...]

    @property
    def block(self) -> syntax.Block | None:
        return self.node.block

    @property
    def header(self) -> Span:
        """The call without its block."""
        if self.block is None:
            return self.node.span
        text = self.node.span.source.text[self.node.span.start : self.block.span.start].rstrip()
        return Span(self.node.span.source, self.node.span.start, self.node.span.start + len(text))


@dataclass(frozen=True, slots=True)
class _Bound:
    """A call that fits: the value of every parameter that was given."""

    signature: Signature
    values: dict[str, typed.Expr]
    result: Type


# ---- what is called -------------------------------------------------------------------------


def call(inference: Inferring, node: syntax.Call, scope: Scope, expected: Type | None) -> typed.Expr:
    given = tuple([_Given(a.label, a.value, a.span) for a in node.arguments or ()])
    match node.callee:
        case syntax.Name() as name:
            return _named(_Call(inference, node, scope, name.text, name.span, given), name, expected)
        case syntax.Member() as target:
            return _member_call(inference, node, target, scope, given, expected)
        case callee:
            value = inference.expr(callee, scope)
            return _value_call(_Call(inference, node, scope, "this function", callee.span, given), value)


def _named(this: _Call, name: syntax.Name, expected: Type | None) -> typed.Expr:
    """`f(...)`: a local function value, a definition of the file, or a built-in."""
    inference = this.inference
    local = this.scope.find(name.text)
    if local is not None:
        return _value_call(this, typed.Local(local.slot, name.text, local.type, name.span))
    named = inference.module.names.get(name.text)
    match named:
        case Definition():
            return _definition_call(this, named, name.span)
        case ModuleName():
            return _not_callable(this, "a whole file")
        case Unresolved():
            return _absorb(this)
        case None:
            pass
    if name.text in BUILTINS and BUILTINS[name.text].signatures:
        return _builtin_call(this, expected)
    if name.text in BUILTINS:
        return _not_callable(this, article(inference.expr(name, this.scope).type))
    if name.text in CSS_COLORS:
        return _not_callable(this, "a colour")
    if name.text:
        inference.report(unknown(inference, name, this.scope, None, called=True))
    return _absorb(this)


def _member_call(
    inference: Inferring,
    node: syntax.Call,
    target: syntax.Member,
    scope: Scope,
    given: tuple[_Given, ...],
    expected: Type | None,
) -> typed.Expr:
    """`x.f(...)`: a name of a module, a field that is a function, or f(x, ...)."""
    name = target.name
    this = _Call(inference, node, scope, name.text, name.span, given)
    module = module_of(inference, target.target, scope)
    if module is not None:
        found = module_member(inference, module, name)
        return _definition_call(this, found, name.span) if found else _absorb(this)
    value = inference.expr(target.target, scope)
    kind = field_type(value.type, name.text)
    if kind is not None:
        return _value_call(this, typed.Field(value, name.text, kind, target.span))
    if isinstance(target.target, syntax.Name) and (
        not _is_known(this, target.target.text)
        or isinstance(inference.module.names.get(target.target.text), Unresolved)
    ):
        return _absorb(this)  # perhaps a module was meant: `math.sqrt(2)`
    receiver = _Given(None, target.target, target.target.span, value, True)
    if not _is_known(this, name.text):
        if not has_error(value.type) and name.text:
            inference.report(_no_method(this, name, value.type))
        return _absorb(this)
    return _named(_Call(inference, node, scope, name.text, name.span, (receiver, *given)), name, expected)


def _is_known(this: _Call, name: str) -> bool:
    return (
        this.scope.first(name) is not None
        or name in this.inference.module.names
        or name in BUILTINS
        or name in CSS_COLORS
    )


def _no_method(this: _Call, name: syntax.Name, kind: Type) -> Diagnostic:
    """Neither a field of the value nor a function."""
    if isinstance(kind, RecordOf):
        near = closest(name.text, [own for own, _ in kind.fields])
        if near:
            return Diagnostic(
                "E0203",
                f"{article(kind)} has no field `{name.text}`",
                name.span,
                "unknown field",
                helps=(Help(f"did you mean `{near}`?", (Edit(name.span, near),)),),
            )
    return unknown(this.inference, name, this.scope, None, called=True)


def _definition_call(this: _Call, definition: Definition, span: Span) -> typed.Expr:
    known = this.inference.known
    match definition.node:
        case syntax.Fn():
            known.use(definition)
            signature = known.signature(definition, span)
            if known.is_incomplete(definition):
                return _absorb(this)
            bound = _bind(this, (signature,))
            if bound is None:
                return typed.Failed(signature.result, this.node.span)
            arguments = tuple([bound.values.get(p.name) for p in signature.parameters])
            return typed.CallFunction(definition, arguments, signature.result, this.node.span)
        case syntax.KernelDecl():
            known.use(definition)
            bound = _bind(this, (known.signature(definition, span),))
            if bound is None:
                return typed.Failed(KERNEL, this.node.span)
            return typed.CallKernel(definition, tuple(bound.values.items()), KERNEL, this.node.span)
        case syntax.TypeAlias():
            return _not_callable(this, "a type")
        case _:
            return _value_call(this, definition_use(this.inference, definition, span, None))


def _value_call(this: _Call, callee: typed.Expr) -> typed.Expr:
    """A function value: it takes its arguments in order, without names."""
    if not isinstance(callee.type, FnOf):
        return _absorb(this) if has_error(callee.type) else _not_callable(this, article(callee.type))
    kind = callee.type
    parameters = tuple([Parameter(f"argument {i + 1}", p) for i, p in enumerate(kind.parameters)])
    text = f"{this.name}: {article(kind).removeprefix('a function ')}"
    bound = _bind(this, (Signature(this.name, parameters, kind.result, text),))
    if bound is None:
        return typed.Failed(kind.result, this.node.span)
    return typed.CallValue(callee, tuple([bound.values[p.name] for p in parameters]), kind.result, this.node.span)


def _builtin_call(this: _Call, expected: Type | None) -> typed.Expr:
    bound = _bind(this, builtin_signatures(this.name))
    if bound is None:
        results = {s.result for s in builtin_signatures(this.name)}
        kind = results.pop() if len(results) == 1 else ERROR
        return typed.Failed(ERROR if is_open(kind) else kind, this.node.span)
    kind = bound.result
    if this.name == "read_records":
        kind = record_type(this.inference, bound.values["file"], expected, this.node.span)
    return typed.CallBuiltin(this.name, tuple(bound.values.items()), kind, this.node.span)


def _absorb(this: _Call) -> typed.Expr:
    """The callee is wrong and reported: check the arguments on their own, for what is in them."""
    for given in this.given:
        if given.value is None and not isinstance(given.node, syntax.Lambda):
            this.inference.expr(given.node, this.scope)
    if this.block is not None:
        this.inference.block(this.block, this.scope, ERROR, lambda node, kind: _not_reached())
    return typed.Failed(ERROR, this.node.span)


def _not_reached() -> Diagnostic:
    raise AssertionError("everything fits where an error was")


def _not_callable(this: _Call, what: str) -> typed.Expr:
    if this.block is not None and this.node.arguments is None:
        this.inference.report(_no_block(this, what))
    else:
        name = f"`{this.name}`" if this.name != "this function" else "this"
        this.inference.report(
            Diagnostic("E0306", f"{name} is {what}: it cannot be called", this.name_span, "not a function")
        )
    return _absorb(this)


# ---- arguments to parameters -----------------------------------------------------------------


def _bind(this: _Call, signatures: tuple[Signature, ...]) -> _Bound | None:
    layouts = [_lay_out(this, signature) for signature in signatures]
    layouts = _with_block(this, layouts)
    if not layouts:
        return None
    if len(signatures) == 1 or len(layouts) == 1:
        return _check_one(this, layouts[0])
    return _choose(this, layouts)


def _lay_out(this: _Call, signature: Signature) -> _Layout:
    layout = _Layout(signature)
    positional = list(signature.positional)
    for given in this.given:
        if given.label is not None:
            _lay_named(this, layout, given, given.label)
            continue
        while positional and not positional[0].rest and positional[0].name in layout.arguments:
            positional.pop(0)
        if positional and positional[0].name == "children" and this.block is not None:
            layout.problems.append(_without_name(this, signature, given))
        elif not positional:
            layout.problems.append(_too_many(this, signature, given))
        elif positional[0].rest:
            layout.rest.append(given)
        else:
            layout.arguments[positional.pop(0).name] = given
    if not layout.problems:
        layout.problems += _missing(this, layout)
    return layout


def _lay_named(this: _Call, layout: _Layout, given: _Given, label: syntax.Name) -> None:
    parameter = layout.signature.parameter(label.text)
    if parameter is None or parameter.rest or parameter.name.startswith("argument "):
        layout.problems.append(_unknown_argument(this, layout.signature, given, label))
    elif parameter.name in layout.arguments:
        layout.problems.append(_given_twice(parameter.name, given, layout.arguments[parameter.name]))
    else:
        layout.arguments[parameter.name] = given


def _missing(this: _Call, layout: _Layout) -> list[Diagnostic]:
    found: list[Diagnostic] = []
    for parameter in layout.signature.parameters:
        if parameter.optional or parameter.rest or parameter.name in layout.arguments:
            continue
        if not (this.block is not None and parameter.name == "children"):
            found.append(_missing_argument(this, layout.signature, parameter))
    return found[:1]


def _with_block(this: _Call, layouts: list[_Layout]) -> list[_Layout]:
    """A trailing block needs a parameter `children` that is still free."""
    if this.block is None:
        return layouts
    takers = [layout for layout in layouts if layout.signature.parameter("children")]
    if not takers:
        this.inference.report(_no_block(this, None))
        _absorb(this)
        return []
    for layout in takers:
        if "children" in layout.arguments:
            layout.problems.append(_given_twice("children", layout.arguments["children"], None, this.block.span))
    return takers


def _check_one(this: _Call, layout: _Layout) -> _Bound | None:
    """The only signature: arguments in the order of its parameters, with their types as hints."""
    wrong = _check_unused(this, layout)
    for problem in layout.problems:
        if problem.span not in wrong:
            this.inference.report(problem)
    bound: dict[str, Type] = {}
    values: dict[str, typed.Expr] = {}
    notes = (layout.signature.text,)
    for parameter in layout.signature.parameters:
        given = layout.arguments.get(parameter.name)
        if given is not None:
            values[parameter.name] = _argument(this, parameter, given, bound, notes)
        elif parameter.rest and layout.rest:
            values[parameter.name] = _rest(this, [_argument(this, parameter, g, bound, notes) for g in layout.rest])
        elif parameter.name == "children" and this.block is not None:
            values[parameter.name] = _block(this, parameter)
    if layout.problems:
        return None
    return _Bound(layout.signature, _converted(layout.signature, values, bound), closed(layout.signature.result, bound))


def _check_unused(this: _Call, layout: _Layout) -> list[Span]:
    """Arguments without a parameter: what is in them can be wrong as well. Those without a name
    where it is: it may be the only mistake."""
    used = [*layout.arguments.values(), *layout.rest]
    wrong: list[Span] = []
    for given in this.given:
        if given not in used and given.value is None and not isinstance(given.node, syntax.Lambda):
            value = this.inference.expr(given.node, this.scope)
            if given.label is None and has_error(value.type):
                wrong.append(given.span)
    return wrong


def _argument(
    this: _Call, parameter: Parameter, given: _Given, bound: dict[str, Type], notes: tuple[str, ...]
) -> typed.Expr:
    wanted = substitute(parameter.type, bound)
    value = given.value or this.inference.expr(given.node, this.scope, wanted)
    if match(parameter.type, value.type, bound):
        if has_error(value.type):  # nothing is known about what stands for the same variables
            bound |= {name: ERROR for name in variables(parameter.type) if name not in bound}
        return value
    if not has_error(value.type):
        place = wording.argument(this.name, parameter.name)
        if isinstance(parameter.type, Variable) and wanted == INT:
            wanted = NUMBER
        if parameter.name.startswith("argument "):
            place = wording.Place(f"`{this.name}` wants", f" as {parameter.name}")
        elif parameter.rest:
            place = wording.Place(f"`{this.name}` wants", " here")
        elif given.receiver:
            place = wording.Place(f"`{this.name}` is for")
        found = wording.mismatch(given.node, value.type, wanted, place)
        this.inference.report(_with_notes(found, notes))
    return typed.Failed(ERROR, value.span)


def _with_notes(found: Diagnostic, notes: tuple[str, ...]) -> Diagnostic:
    """The signature helps, except where a unit is all that is missing."""
    if found.code == "E0301":
        return found
    return Diagnostic(
        found.code, found.message, found.span, found.label, found.labels, found.helps, (*found.notes, *notes)
    )


def _rest(this: _Call, values: list[typed.Expr]) -> typed.Expr:
    items = tuple([typed.Item(value, value.span) for value in values])
    return typed.List(items, ListOf(values[0].type), this.node.span)


def _block(this: _Call, parameter: Parameter) -> typed.Expr:
    assert this.block is not None
    wanted = _element_type(parameter.type)
    if wanted is None:
        this.inference.report(_block_is_list(this, parameter))
        _absorb(this)
        return typed.Failed(ERROR, this.block.span)
    header = this.header
    return this.inference.block(
        this.block,
        this.scope,
        wanted,
        lambda node, kind: wording.element_of_block(node, kind, wanted, this.name, header),
    )


def _element_type(kind: Type) -> Type | None:
    """What a block for this parameter holds."""
    options = kind.options if isinstance(kind, OneOf) else (kind,)
    for option in options:
        if isinstance(option, ListOf):
            return option.element
    return ERROR if has_error(kind) else None


def _converted(signature: Signature, values: dict[str, typed.Expr], bound: dict[str, Type]) -> dict[str, typed.Expr]:
    result: dict[str, typed.Expr] = {}
    for name, value in values.items():
        parameter = signature.parameter(name)
        assert parameter is not None
        wanted = substitute(parameter.type, bound)
        if parameter.rest:
            wanted = ListOf(wanted)
        result[name] = value if isinstance(value, typed.Failed) else converted(value, wanted)
    return result


# ---- overloads ---------------------------------------------------------------------------------


def _choose(this: _Call, layouts: list[_Layout]) -> _Bound | None:
    """The first signature whose parameters take the arguments; else the nearest one says why not."""
    whole = [layout for layout in layouts if not layout.problems] or layouts
    hints = _hints(whole)
    checked = {id(g): g.value or this.inference.expr(g.node, this.scope, hints.get(id(g))) for g in this.given}
    if any(has_error(value.type) for value in checked.values()):
        for problem in min(whole, key=lambda one: _distance(this, one)).problems:
            this.inference.report(problem)
        if this.block is not None:
            _check_block_only(this, whole)
        return None
    layout = min(whole, key=lambda one: (_distance(this, one) if one.problems else (0, 0), _misfits(one, checked)))
    given = tuple([_Given(g.label, g.node, g.span, checked[id(g)], g.receiver) for g in this.given])
    again = _Call(this.inference, this.node, this.scope, this.name, this.name_span, given)
    fresh = _lay_out(again, layout.signature)
    return _check_one(again, fresh)


def _check_block_only(this: _Call, whole: list[_Layout]) -> None:
    parameter = whole[0].signature.parameter("children")
    if parameter is not None:
        _block(this, parameter)


def _hints(layouts: Sequence[_Layout]) -> dict[int, Type]:
    """What each argument might be, over all signatures; only for literals and did-you-mean."""
    found: dict[int, list[Type]] = {}
    for layout in layouts:
        for name, given in layout.arguments.items():
            parameter = layout.signature.parameter(name)
            if parameter is not None:
                found.setdefault(id(given), []).append(parameter.type)
        for given in layout.rest:
            found.setdefault(id(given), []).append(layout.signature.parameters[-1].type)
    return {key: kinds[0] if len(kinds) == 1 else OneOf(tuple(kinds)) for key, kinds in found.items()}


def _misfits(layout: _Layout, checked: dict[int, typed.Expr]) -> int:
    bound: dict[str, Type] = {}
    count = 0
    for parameter in layout.signature.parameters:
        given = [layout.arguments[parameter.name]] if parameter.name in layout.arguments else []
        for one in layout.rest if parameter.rest else given:
            count += not match(parameter.type, checked[id(one)].type, bound)
    return count


def _distance(this: _Call, layout: _Layout) -> tuple[int, int]:
    """How far the arguments are from a signature: unknown names first, then their number."""
    unknown_names = sum(1 for g in this.given if g.label and not layout.signature.parameter(g.label.text))
    plain = sum(1 for g in this.given if not g.label)
    return unknown_names, max(0, plain - len(layout.signature.positional))


# ---- what goes wrong ---------------------------------------------------------------------------


def _unknown_argument(this: _Call, signature: Signature, given: _Given, label: syntax.Name) -> Diagnostic:
    if signature.parameters and signature.parameters[0].name.startswith("argument "):
        return Diagnostic(
            "E0303",
            f"`{this.name}` is a function value: its arguments have no names",
            given.span,
            "give it without a name",
            helps=(Help("leave the name out", (Edit(given.span, given.node.span.text),)),),
        )
    advice, meant = FOREIGN_ARGUMENTS.get((this.name, label.text), ("", ""))
    near = meant or _nearest_parameter(this, signature, given, label)
    respelt = (Help(f"did you mean `{near}`?", (Edit(label.span, near),)),) if near else ()
    helps = (Help(advice),) if advice else respelt
    return Diagnostic(
        "E0303",
        f"`{this.name}` has no argument `{label.text}`",
        given.span,
        f"not an argument of `{this.name}`",
        helps=helps,
        notes=(signature.text,),
    )


def _nearest_parameter(this: _Call, signature: Signature, given: _Given, label: syntax.Name) -> str | None:
    """A parameter of nearly this name, or one that it shortens, that is not given and would fit."""
    taken = {g.label.text for g in this.given if g.label}
    free = [p for p in signature.parameters if p.name not in taken and _could_take(given, p)]
    near = closest(label.text, [p.name for p in free])
    if near is None:
        starts = [p.name for p in free if p.name.startswith(label.text) or label.text.startswith(p.name)]
        near = starts[0] if starts else None
    return near


def _could_take(given: _Given, parameter: Parameter) -> bool:
    """Would a literal fit there? Anything else might."""
    match given.node:
        case syntax.Number() | syntax.Angle() | syntax.Text() | syntax.Bool() | syntax.Vector():
            kinds: dict[type, str]
            kinds = {syntax.Number: "number", syntax.Angle: "angle", syntax.Text: "text", syntax.Bool: "bool"}
            return (
                fits(PRIMITIVES[kinds.get(type(given.node), "vec3")], parameter.type)
                or parameter.type == PRIMITIVES["int"]
            )
        case _:
            return True


def _too_many(this: _Call, signature: Signature, given: _Given) -> Diagnostic:
    positional = [p for p in signature.positional if not (this.block is not None and p.name == "children")]
    count = len(positional)
    by_name = [p.name for p in signature.parameters if p.named_only]
    few = "no arguments" if count == 0 else "1 argument" if count == 1 else f"{count} arguments"
    helps = (Help("give the others by name: " + ", ".join([f"{name} = ..." for name in by_name])),) if by_name else ()
    without = " without a name" if by_name else ""
    return Diagnostic(
        "E0303",
        f"`{this.name}` takes {few}{without}, but more are given",
        given.span,
        "one too many",
        helps=helps,
        notes=(signature.text,),
    )


def _without_name(this: _Call, signature: Signature, given: _Given) -> Diagnostic:
    """`surface(0.5) { ... }`: the place of the block is taken by the block."""
    others = [p.name for p in signature.parameters if p.name != "children" and _could_take(given, p)]
    helps = (
        (
            Help(
                f"did you mean `{others[0]}`?",
                (Edit(Span(given.span.source, given.span.start, given.span.start), f"{others[0]} = "),),
            ),
        )
        if others
        else ()
    )
    return Diagnostic(
        "E0303",
        f"with a block, `{this.name}` takes its other arguments by name",
        given.span,
        "which argument is this?",
        helps=helps,
        notes=(signature.text,),
    )


def _given_twice(name: str, given: _Given, first: _Given | None, span: Span | None = None) -> Diagnostic:
    labels = (Label(first.span, "given here already"),) if first else (Label(given.span, "given here already"),)
    return Diagnostic("E0303", f"`{name}` is given twice", span or given.span, "given again", labels)


def _missing_argument(this: _Call, signature: Signature, parameter: Parameter) -> Diagnostic:
    if parameter.name.startswith("argument "):
        message = f"`{this.name}` wants {len(signature.parameters)} arguments, but {len(this.given)} are given"
        return Diagnostic("E0302", message, this.header, f"{parameter.name} is missing", notes=(signature.text,))
    return Diagnostic(
        "E0302",
        f"`{this.name}` needs `{parameter.name}`",
        this.header,
        f"`{parameter.name}`, {article(parameter.type)}, is missing",
        notes=(signature.text,),
    )


def _no_block(this: _Call, what: str | None) -> Diagnostic:
    assert this.block is not None
    brace = Span(this.block.span.source, this.block.span.start, this.block.span.start + 1)
    reason = f"`{this.name}` is {what}" if what else f"`{this.name}` has no argument `children`"
    return Diagnostic(
        "E0307",
        f"`{this.name}` takes no block",
        brace,
        "no block here",
        (Label(this.name_span, reason),),
        (Help("a block is the last argument of what stands before it, for functions with a parameter `children`"),),
    )


def _block_is_list(this: _Call, parameter: Parameter) -> Diagnostic:
    assert this.block is not None
    return Diagnostic(
        "E0307",
        f"a block is a list, but `children` of `{this.name}` is {article(parameter.type)}",
        Span(this.block.span.source, this.block.span.start, this.block.span.start + 1),
        "no list is wanted",
        helps=(Help("declare it as a list, for example `children: [field]`"),),
    )
