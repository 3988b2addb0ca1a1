"""Uses of names: which definition, local name or built-in a word means, and what it might have meant."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from blobscript import syntax, typed
from blobscript.callables import Signature, builtin_signatures, builtin_type
from blobscript.css import CSS_COLORS
from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.inferring import Inferring
from blobscript.resolve import Definition, ModuleName, Unresolved, defined_twice
from blobscript.scopes import Scope
from blobscript.signatures import BUILTINS, TYPE_NAMES
from blobscript.source import Span
from blobscript.suggest import closest, distance
from blobscript.types import (
    COLOR,
    ERROR,
    KERNEL,
    NUMBER,
    PRIMITIVES,
    VEC3,
    FnOf,
    ListOf,
    RecordOf,
    Type,
    Variable,
    article,
    has_error,
    is_open,
    match,
    substitute,
)
from blobscript.words import FOREIGN_CALLS, FOREIGN_NAMES

__all__ = [
    "bind",
    "builtin_value",
    "definition_use",
    "function_of",
    "function_value",
    "member",
    "module_member",
    "name_use",
    "type_of_syntax",
    "unknown",
]


# ---- introducing names --------------------------------------------------------------------


def bind(inference: Inferring, name: syntax.Name, kind: Type, scope: Scope) -> int:
    """A new local name; it may hide no other name of the file. `_` is no name and may be repeated."""
    first = scope.first(name.text) or inference.module.spans.get(name.text)
    if first is not None and name.text not in ("_", ""):
        inference.report(defined_twice(name, first))
    return scope.add(name.text, kind, name.span)


# ---- types as written -----------------------------------------------------------------------


def type_of_syntax(inference: Inferring, node: syntax.TypeSyntax) -> Type:
    match node:
        case syntax.NamedType(name, span):
            return _named_type(inference, name, span)
        case syntax.ListType(element):
            return ListOf(type_of_syntax(inference, element))
        case syntax.RecordType(fields):
            return RecordOf(tuple([(name.text, type_of_syntax(inference, kind)) for name, kind in fields]))
        case syntax.FnType(parameters, result):
            kinds = [type_of_syntax(inference, p) for p in parameters]
            return FnOf(tuple(kinds), type_of_syntax(inference, result))
        case syntax.Error():
            return ERROR
        case _:
            assert_never(node)


def _named_type(inference: Inferring, name: str, span: Span) -> Type:
    named = inference.module.names.get(name)
    if isinstance(named, Definition) and isinstance(named.node, syntax.TypeAlias):
        return inference.known.alias(named)
    if isinstance(named, Unresolved):
        return ERROR
    if name in PRIMITIVES:
        return PRIMITIVES[name]
    aliases = [
        own
        for own, known in inference.module.names.items()
        if isinstance(known, Definition) and isinstance(known.node, syntax.TypeAlias)
    ]
    near = _FOREIGN_TYPES.get(name.lower()) or closest(name, [*TYPE_NAMES, *aliases])
    inference.report(
        Diagnostic(
            "E0201",
            f"there is no type `{name}` here",
            span,
            "unknown type" if named is None else "this is a value, not a type",
            helps=(Help(f"the type `{near}` is close", (Edit(span, near),)),) if near else (),
        )
    )
    return ERROR


_FOREIGN_TYPES = {
    "float": "number", "double": "number", "real": "number", "integer": "int", "string": "text", "str": "text",
    "boolean": "bool", "vec": "vec3", "vector": "vec3", "point": "vec3", "colour": "color", "degrees": "angle",
}  # fmt: skip


# ---- names as values --------------------------------------------------------------------------


def name_use(inference: Inferring, node: syntax.Name, scope: Scope, expected: Type | None) -> typed.Expr:
    """A name that stands for a value (not in front of arguments)."""
    local = scope.find(node.text)
    if local is not None:
        return typed.Local(local.slot, node.text, local.type, node.span)
    named = inference.module.names.get(node.text)
    match named:
        case Definition():
            return definition_use(inference, named, node.span, expected)
        case ModuleName():
            return _no_value(inference, node, "a whole file", f"name one of its values: {node.text}.name")
        case Unresolved():
            return typed.Failed(ERROR, node.span)
        case None:
            pass
        case _:
            assert_never(named)
    if node.text in BUILTINS:
        return builtin_value(inference, node, expected)
    if node.text in CSS_COLORS:
        return typed.Constant(_color(node.text), COLOR, node.span)
    if node.text:
        inference.report(unknown(inference, node, scope, expected))
    return typed.Failed(ERROR, node.span)


def _color(name: str) -> object:
    from blobscript.values import Color

    rgb = CSS_COLORS[name]
    return Color.from_srgb((rgb >> 16) / 255, (rgb >> 8 & 255) / 255, (rgb & 255) / 255)


def _no_value(inference: Inferring, node: syntax.Name, what: str, help_: str) -> typed.Expr:
    inference.report(
        Diagnostic("E0304", f"`{node.text}` is {what}, not a value", node.span, what, helps=(Help(help_),))
    )
    return typed.Failed(ERROR, node.span)


def definition_use(inference: Inferring, definition: Definition, span: Span, expected: Type | None) -> typed.Expr:
    """The value of a definition of this or another file."""
    known = inference.known
    known.use(definition)
    match definition.node:
        case syntax.Let() | syntax.Param():
            return typed.Global(definition, known.value_type(definition, span), span)
        case syntax.Fn():
            signature = known.signature(definition, span)
            return function_value(inference, definition, (signature,), span, expected)
        case syntax.KernelDecl():
            missing = [p.name for p in known.signature(definition, span).parameters if not p.optional]
            if missing:
                inference.report(_kernel_needs(definition, missing, span))
                return typed.Failed(KERNEL, span)
            return typed.CallKernel(definition, (), KERNEL, span)
        case syntax.TypeAlias():
            name = syntax.Name(definition.name, span)
            return _no_value(inference, name, "a type", "types stand behind a colon, as in `let a: Name = ...`")
        case _:
            assert_never(definition.node)


def _kernel_needs(definition: Definition, missing: list[str], span: Span) -> Diagnostic:
    given = ", ".join([f"{name} = 1" for name in missing])
    return Diagnostic(
        "E0302",
        f"the kernel `{definition.name}` needs `{missing[0]}`",
        span,
        f"`{missing[0]}` is missing",
        helps=(Help("give it in parentheses", (Edit(span.at_end, f"({given})"),)),),
    )


def builtin_value(inference: Inferring, node: syntax.Name, expected: Type | None) -> typed.Expr:
    """A built-in name without arguments: a material, a kernel, `pi`, or a function as a value."""
    row = BUILTINS[node.text]
    if row.value is None or (isinstance(expected, FnOf) and row.signatures):
        return function_value(inference, None, builtin_signatures(node.text), node.span, expected)
    kind = builtin_type(row.value)
    return typed.CallBuiltin(node.text, (), kind, node.span)


def function_value(
    inference: Inferring,
    definition: Definition | None,
    signatures: tuple[Signature, ...],
    span: Span,
    expected: Type | None,
) -> typed.Expr:
    """A function as a value: the overload that takes what it will be given."""
    if isinstance(expected, FnOf):
        for signature in signatures:
            kind = function_of(signature, expected.parameters)
            if kind is not None:
                return typed.FunctionValue(definition, None if definition else signature, kind, span)
    signature = signatures[0]
    if has_error(signature.result):
        return typed.Failed(ERROR, span)
    if len(signatures) > 1 or is_open(signature.type):
        name = signature.name
        inference.report(
            Diagnostic(
                "E0305",
                f"`{name}` takes values of several types, so it needs a function around it here",
                span,
                "which one?",
                helps=(Help("say which values it is for, for example", (Edit(span, f"fn(x: number) = {name}(x)"),)),),
                notes=tuple([s.text for s in signatures]),
            )
        )
        return typed.Failed(ERROR, span)
    return typed.FunctionValue(definition, None if definition else signature, signature.type, span)


def function_of(signature: Signature, given: tuple[Type, ...]) -> FnOf | None:
    """The signature as a function of these positional arguments; None if it does not take them."""
    positional = signature.positional
    if len(given) > len(positional) or any(p.rest for p in positional):
        return None
    if any(
        not p.optional for p in (*positional[len(given) :], *signature.parameters) if p not in positional[: len(given)]
    ):
        return None
    bound: dict[str, Type] = {}
    for parameter, kind in zip(positional, given, strict=False):
        if not isinstance(kind, Variable) and not match(parameter.type, kind, bound):
            return None
    taken = [
        substitute(p.type, bound) if isinstance(kind, Variable) else kind
        for p, kind in zip(positional, given, strict=False)
    ]
    return FnOf(tuple(taken), substitute(signature.result, bound))


# ---- members ------------------------------------------------------------------------------------


def member(inference: Inferring, node: syntax.Member, scope: Scope) -> typed.Expr:
    """`x.f` without arguments: a field, a part of a vector, or a name of a module."""
    module = module_of(inference, node.target, scope)
    if module is not None:
        found = module_member(inference, module, node.name)
        if found is None:
            return typed.Failed(ERROR, node.span)
        return definition_use(inference, found, node.name.span, None)
    target = inference.expr(node.target, scope)
    kind = field_type(target.type, node.name.text)
    if kind is not None:
        return typed.Field(target, node.name.text, kind, node.span)
    if not has_error(target.type) and node.name.text:
        inference.report(_no_field(inference, node, target.type, scope))
    return typed.Failed(ERROR, node.span)


def module_of(inference: Inferring, node: syntax.Expr, scope: Scope) -> ModuleName | None:
    if isinstance(node, syntax.Name) and scope.first(node.text) is None:
        named = inference.module.names.get(node.text)
        return named if isinstance(named, ModuleName) else None
    return None


def module_member(inference: Inferring, module: ModuleName, name: syntax.Name) -> Definition | None:
    """The definition of this name in the file of a module (not what that file imports)."""
    found = module.module.names.get(name.text)
    if isinstance(found, Definition) and found.module is module.module:
        return found
    own = [known for known, d in module.module.names.items() if isinstance(d, Definition) and d.module is module.module]
    near = closest(name.text, own)
    if name.text:
        inference.report(
            Diagnostic(
                "E0205",
                f"`{module.name}` has no `{name.text}`",
                name.span,
                "not defined there",
                helps=(Help(f"did you mean `{near}`?", (Edit(name.span, near),)),) if near else (),
                notes=("it defines " + (", ".join([f"`{known}`" for known in sorted(own)]) or "nothing"),),
            )
        )
    return None


def field_type(kind: Type, name: str) -> Type | None:
    if kind == VEC3:
        return NUMBER if name in ("x", "y", "z") else None
    return kind.field(name) if isinstance(kind, RecordOf) else None


def _no_field(inference: Inferring, node: syntax.Member, kind: Type, scope: Scope) -> Diagnostic:
    name = node.name
    fields = ["x", "y", "z"] if kind == VEC3 else [own for own, _ in kind.fields] if isinstance(kind, RecordOf) else []
    near = closest(name.text, fields)
    helps: tuple[Help, ...] = ()
    if near:
        helps = (Help(f"did you mean `{near}`?", (Edit(name.span, near),)),)
    elif isinstance(kind, ListOf) and name.text in ("length", "size", "count"):
        helps = (Help("how many it holds is its `len`", (Edit(name.span, "len()"),)),)
    elif isinstance(kind, ListOf) and name.text in ("x", "y", "z"):
        helps = (Help("a vector, which has them, is written in parentheses: (x, y, z)"),)
    elif _is_function(inference, name.text):
        helps = (Help(f"`{name.text}` is a function: call it", (Edit(name.span.at_end, "()"),)),)
    return Diagnostic(
        "E0203",
        f"{article(kind)} has no field `{name.text}`",
        name.span,
        "unknown field",
        (Label(node.target.span, article(kind)),),
        helps,
        ("its fields are " + ", ".join([f"`{own}`" for own in fields]),) if fields else (),
    )


def _is_function(inference: Inferring, name: str) -> bool:
    named = inference.module.names.get(name)
    if isinstance(named, Definition):
        return isinstance(named.node, syntax.Fn)
    return name in BUILTINS and bool(BUILTINS[name].signatures)


# ---- unknown names ------------------------------------------------------------------------------


def unknown(
    inference: Inferring, node: syntax.Name, scope: Scope, expected: Type | None, *, called: bool = False
) -> Diagnostic:
    """No such name: the closest one that would fit here, or the import that would bring it in."""
    found = {name: word for name, kind, word in _candidates(inference, scope, called) if _would_fit(kind, expected)}
    near = closest(node.text, found)
    if near in CSS_COLORS and expected is None and distance(node.text, near) > 1:
        near = None  # there are so many of them
    helps: tuple[Help, ...] = ()
    elsewhere = FOREIGN_CALLS if called else FOREIGN_NAMES
    if node.text in elsewhere and (near is None or near in BUILTINS or near in CSS_COLORS):
        advice, word = elsewhere[node.text]
        helps = (Help(advice, (Edit(node.span, word),) if word else ()),)
    elif near is not None:
        word = found[near]
        text = f"the {word} `{near}` is close" if word else f"did you mean `{near}`?"
        helps = (Help(text, (Edit(node.span, near),)),)
    else:
        helps = _from_library(inference, node)
    return Diagnostic("E0201", f"there is no `{node.text}` here", node.span, "unknown name", helps=helps)


def _would_fit(kind: Type | None, expected: Type | None) -> bool:
    if kind is None or expected is None or (isinstance(expected, Variable) and not expected.allowed):
        return True
    return match(expected, kind, {})


#: Kind of a built-in -> the word for it in "the ... is close".
_WORDS = {"material": "material", "kernel": "kernel"}


def _candidates(inference: Inferring, scope: Scope, called: bool) -> Iterator[tuple[str, Type | None, str]]:
    """Every name that could stand here: its type (None: not known yet) and what to call it."""
    for name, kind in scope.all():
        if not called or isinstance(kind, FnOf):
            yield name, kind, ""
    for name, named in inference.module.names.items():
        if isinstance(named, Definition):
            yield from _definition_candidate(inference, named, name, called)
    for name, row in BUILTINS.items():
        if called and row.signatures:
            yield name, None, _WORDS.get(row.kind, "function")
        elif not called and row.value is not None:
            yield name, builtin_type(row.value), _WORDS.get(row.kind, "")
    if not called:
        for name in CSS_COLORS:
            yield name, COLOR, "colour"


def _definition_candidate(
    inference: Inferring, named: Definition, name: str, called: bool
) -> Iterator[tuple[str, Type | None, str]]:
    match named.node:
        case syntax.Fn():
            if called:
                yield name, None, "function"
        case syntax.KernelDecl():
            yield name, None if called else KERNEL, "kernel"
        case syntax.Let() | syntax.Param():
            kind = inference.known.type_if_known(named)
            if not called or isinstance(kind, FnOf):
                yield name, kind, ""
        case _:
            pass


def _from_library(inference: Inferring, node: syntax.Name) -> tuple[Help, ...]:
    """A name of the standard library, with the line that imports it."""
    from blobscript.imports import standard_definitions

    if inference.module.source.path.startswith("stdlib/"):
        return ()
    library = standard_definitions()
    near = node.text if node.text in library else closest(node.text, library)
    if near is None:
        return ()
    line = f"import {near} from {library[near]}"
    edits = [Edit(_import_place(inference), line + "\n")]
    if near != node.text:
        edits.append(Edit(node.span, near))
    return (Help(f"`{near}` is in the standard library: {line}", tuple(edits)),)


def _import_place(inference: Inferring) -> Span:
    """The empty place behind the line `blobscript 1`, or the start of the file."""
    source = inference.module.source
    at = 0
    if inference.module.script.edition is not None:
        at = source.text.find("\n", source.text.find("blobscript ")) + 1
    return Span(source, at, at)
