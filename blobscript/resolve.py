"""Names to definitions, and files to modules: the second pass.

Every file becomes a `Module` with the names that it defines or imports, and its definitions in an
order in which each comes after those that it needs. Definitions may stand in any order in the
file; one that needs its own value is an error (functions may call themselves).

Local names (parameters, `let` in blocks, loop variables) are the checker's: nothing in a file may
hide another name of that file, so a word that is a name of the file means that wherever it stands.

Non-goals: nothing is known about types here, so members (`x.f`) and unknown names are left alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from blobscript import syntax
from blobscript.deep import deeply
from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.imports import Imports
from blobscript.source import Source, Span
from blobscript.suggest import closest

__all__ = [
    "Definition",
    "Module",
    "ModuleName",
    "Program",
    "Unresolved",
    "defined_twice",
    "free_names",
    "resolve",
    "told",
]

DefinitionNode = syntax.Let | syntax.Param | syntax.Fn | syntax.KernelDecl | syntax.TypeAlias


@dataclass(slots=True, eq=False)
class Definition:
    """A name that a file defines. `failed`: reported already, its type absorbs what follows.

    `recursive`: a function that calls itself, perhaps through others.
    """

    name: str
    node: DefinitionNode
    module: Module
    failed: bool = False
    recursive: bool = False

    @property
    def name_span(self) -> Span:
        return self.node.name.span


@dataclass(slots=True, eq=False)
class ModuleName:
    """The name that a whole file was imported as."""

    name: str
    module: Module
    span: Span


@dataclass(slots=True, eq=False)
class Unresolved:
    """A name whose import failed; reported, so it absorbs everything."""

    name: str
    span: Span


Named = Definition | ModuleName | Unresolved


@dataclass(slots=True, eq=False)
class Module:
    """One file. `imported_at`: the import that brought it in (None: the main script)."""

    source: Source
    script: syntax.Script
    imported_at: Span | None = None
    names: dict[str, Named] = field(default_factory=dict[str, Named])
    spans: dict[str, Span] = field(default_factory=dict[str, Span])  # where this file introduced each name
    definitions: tuple[Definition, ...] = ()  # in the order of need

    @property
    def is_standard(self) -> bool:
        """Of the standard library: whatever else is imported has a folder."""
        return self.imported_at is not None and self.source.folder is None

    @property
    def items(self) -> tuple[syntax.Item, ...]:
        """What is no definition: scene items, loops, assertions."""
        return tuple([item for item in self.script.items if not isinstance(item, _DEFINING)])


@dataclass(slots=True, eq=False)
class Program:
    """All files, imported ones before those that import them; the last is the main script."""

    modules: tuple[Module, ...]

    @property
    def main(self) -> Module:
        return self.modules[-1]


def told(found: Iterable[Diagnostic], modules: Sequence[Module]) -> list[Diagnostic]:
    """Findings as they are handed on: with the imports that led to them, in order of place, the main script first."""
    main = modules[-1].source
    return sorted([_with_trail(one, modules) for one in found], key=lambda one: _place(one, main))


def _place(found: Diagnostic, main: Source) -> tuple[bool, str, int]:
    span = found.span
    return (False, "", 0) if span is None else (span.source is not main, span.source.path, span.start)


def _with_trail(found: Diagnostic, modules: Sequence[Module]) -> Diagnostic:
    """A finding in an imported file also shows the imports that led there, outermost last.

    Not where its labels lead to another file already: those are the calls that led there.
    """
    if found.span is None or any(label.span.source is not found.span.source for label in found.labels):
        return found
    by_source = {id(module.source): module.imported_at for module in modules}
    labels = list(found.labels)
    span = found.span
    while (span := by_source.get(id(span.source))) is not None:
        labels.append(Label(span, "imported here"))
    return replace(found, labels=tuple(labels)) if len(labels) > len(found.labels) else found


_DEFINING = (
    syntax.Let,
    syntax.Param,
    syntax.Fn,
    syntax.KernelDecl,
    syntax.TypeAlias,
    syntax.ImportNames,
    syntax.ImportModule,
)


def resolve(script: syntax.Script) -> tuple[Program, list[Diagnostic]]:
    """The script with everything it imports, and what is wrong with its names."""
    resolver = _Resolver(Imports(script.source))
    deeply(lambda: resolver.load(script, None))
    return Program(tuple(resolver.done)), told(resolver.diagnostics, resolver.done)


class _Resolver:
    def __init__(self, files: Imports) -> None:
        self.files = files
        self.done: list[Module] = []
        self.diagnostics: list[Diagnostic] = []
        self._by_file: dict[str, Module] = {}
        self._loading: list[str] = []

    def load(self, script: syntax.Script, imported_at: Span | None) -> Module:
        module = Module(script.source, script, imported_at)
        for item in script.items:
            self._introduce(module, item)
        module.definitions = tuple(self._ordered(module))
        self.done.append(module)
        return module

    # ---- names ------------------------------------------------------------------------

    def _introduce(self, module: Module, item: syntax.TopItem) -> None:
        match item:
            case syntax.ImportNames():
                self._import_names(module, item)
            case syntax.ImportModule():
                found = self._import(module, item)
                named = ModuleName(item.alias.text, found, item.alias.span) if found else None
                self._name(module, item.alias, named or Unresolved(item.alias.text, item.alias.span))
            case syntax.Let() | syntax.Param() | syntax.Fn() | syntax.KernelDecl() | syntax.TypeAlias():
                self._name(module, item.name, Definition(item.name.text, item, module))
            case _:
                pass

    def _name(self, module: Module, name: syntax.Name, named: Named) -> None:
        if not name.text:  # a word that the parser had to invent
            return
        first = module.spans.get(name.text)
        if first is not None:
            self.diagnostics.append(defined_twice(name, first))
            return
        module.spans[name.text] = name.span
        module.names[name.text] = named

    def _import_names(self, module: Module, item: syntax.ImportNames) -> None:
        found = self._import(module, item)
        for name in item.names:
            named = found.names.get(name.text) if found else None
            if found and not isinstance(named, Unresolved) and not _defines(found, named):
                named = None
                self.diagnostics.append(_not_in_module(name, item.path, found))
            self._name(module, name, named or Unresolved(name.text, name.span))

    # ---- files ------------------------------------------------------------------------

    def _import(self, module: Module, item: syntax.ImportNames | syntax.ImportModule) -> Module | None:
        """The module of an import, loaded once; None if that was reported."""
        place = self.files.find(module.source, item)
        if isinstance(place, Diagnostic):
            self.diagnostics.append(place)
            return None
        if place.key in self._by_file:
            return self._by_file[place.key]
        if place.key in self._loading:
            self.diagnostics.append(_import_cycle(item, place.shown))
            return None
        script = self.files.parse(place, item)
        if isinstance(script, Diagnostic):
            self.diagnostics.append(script)
            return None
        self._loading.append(place.key)
        parsed, problems = script
        self.diagnostics += problems
        found = self.load(parsed, item.path_span)
        self._loading.pop()
        self._by_file[place.key] = found
        return found

    # ---- order ------------------------------------------------------------------------

    def _ordered(self, module: Module) -> Iterator[Definition]:
        own = {name: d for name, d in module.names.items() if isinstance(d, Definition) and d.module is module}
        needs = {
            name: {use: span for use, span in free_names(definition.node) if use in own}
            for name, definition in own.items()
        }
        for group in _components(needs):
            members = [own[name] for name in group]
            if _is_circle(group, needs) and _is_real(members, needs):
                self._circle(members, needs)
            yield from members

    def _circle(self, members: list[Definition], needs: dict[str, dict[str, Span]]) -> None:
        """Functions may need each other, values may not."""
        values = [d for d in members if not isinstance(d.node, syntax.Fn)]
        for definition in members:
            definition.recursive = isinstance(definition.node, syntax.Fn)
        for definition in values:
            definition.failed = True
        if values:
            self.diagnostics.append(_cycle(min(values, key=lambda d: d.name_span.start), members, needs))


def _is_circle(group: Sequence[str], needs: dict[str, dict[str, Span]]) -> bool:
    return len(group) > 1 or group[0] in needs[group[0]]


def _is_real(members: list[Definition], needs: dict[str, dict[str, Span]]) -> bool:
    """Not where local names hide those of the file: that is wrong as well, and said by the checker (E0202)."""
    names = {d.name for d in members}
    left = {d.name: needs[d.name].keys() & names - set(_bound_names(d.node)) for d in members}
    rest = {name: {use: needs[name][use] for use in uses} for name, uses in left.items()}
    return any(_is_circle(group, rest) for group in _components(rest))


def _components(needs: dict[str, dict[str, Span]]) -> Iterator[list[str]]:
    """Strongly connected components, needed ones first (Tarjan 1972, with its own stack)."""
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    open_names: list[str] = []
    for root in needs:
        if root in number:
            continue
        number[root] = low[root] = len(number)
        open_names.append(root)
        work = [(root, iter(needs[root]))]
        while work:
            name, rest = work[-1]
            for use in rest:
                if use not in number:
                    number[use] = low[use] = len(number)
                    open_names.append(use)
                    work.append((use, iter(needs[use])))
                    break
                if use in open_names:
                    low[name] = min(low[name], number[use])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[name])
                if low[name] == number[name]:
                    at = open_names.index(name)
                    yield open_names[at:]
                    del open_names[at:]


# ---- free names -----------------------------------------------------------------------

#: Node -> where its parts are; names in other places (labels, members, bound names) mean no definition.
_PARTS: dict[type, tuple[str, ...]] = {
    syntax.Argument: ("value",),
    syntax.Assert: ("condition", "message"),
    syntax.Binary: ("left", "right"),
    syntax.Block: ("items",),
    syntax.Debug: ("value",),
    syntax.Fn: ("parameters", "result", "statements", "body"),
    syntax.FnType: ("parameters", "result"),
    syntax.For: ("iterable", "body"),
    syntax.ForElement: ("iterable", "body"),
    syntax.Group: ("inner",),
    syntax.If: ("condition", "then", "otherwise"),
    syntax.IfElement: ("condition", "then"),
    syntax.IfExpr: ("condition", "then", "otherwise"),
    syntax.Index: ("target", "index"),
    syntax.KernelDecl: ("parameters", "body"),
    syntax.Lambda: ("parameters", "result", "body"),
    syntax.Let: ("type", "value"),
    syntax.List: ("items",),
    syntax.ListType: ("element",),
    syntax.Member: ("target",),
    syntax.Param: ("type", "default", "allowed", "step"),
    syntax.Parameter: ("type", "default"),
    syntax.Range: ("lo", "hi"),
    syntax.Spread: ("value",),
    syntax.Text: ("parts",),
    syntax.TypeAlias: ("type",),
    syntax.Unary: ("operand",),
    syntax.Vector: ("items",),
}


def free_names(node: object) -> Iterator[tuple[str, Span]]:
    """All words of a tree that may mean a name of the file, with their places.

    A member that is called may be a function (`x.f(a)`), so its name counts as well.
    """
    stack: list[object] = [node]
    while stack:
        node = stack.pop()
        match node:
            case syntax.Name(text, span):
                yield text, span
            case syntax.NamedType(name, span):
                yield name, span
            case syntax.Call(syntax.Member(_, name)):
                yield name.text, name.span
                stack += _parts(node)
            case _:
                stack += _parts(node)


def _bound_names(definition: DefinitionNode) -> Iterator[str]:
    """The local names within a definition: parameters, `let` and loop variables."""
    stack = _parts(definition)
    while stack:
        node = stack.pop()
        match node:
            case syntax.For(binder) | syntax.ForElement(binder):
                yield from (name.text for name in (binder.index, binder.value) if name is not None)
            case syntax.Parameter(name) | syntax.Let(name):
                yield name.text
            case _:
                pass
        stack += _parts(node)


def _parts(node: object) -> list[object]:
    match node:
        case syntax.Call(callee, arguments, block):
            return [block, *(arguments or ()), callee]
        case syntax.Record(fields) | syntax.RecordType(fields):
            return [value for _, value in fields]
        case _:
            found: list[object] = []
            for part in _PARTS.get(type(node), ()):
                value = getattr(node, part)
                found += value if isinstance(value, tuple) else (value,)
            return found


def _defines(module: Module, named: Named | None) -> bool:
    """Is it the file's own? What a file imports is not passed on."""
    return isinstance(named, Definition) and named.module is module


# ---- what goes wrong ------------------------------------------------------------------


def defined_twice(name: syntax.Name, first: Span) -> Diagnostic:
    return Diagnostic(
        "E0202",
        f"`{name.text}` is defined twice",
        name.span,
        "second definition",
        (Label(first, "first definition"),),
        (
            Help(
                "a name keeps one value; nothing is ever overwritten.\n"
                "Give the second one its own name, or pass it as an argument"
            ),
        ),
    )


def _not_in_module(name: syntax.Name, path: str, found: Module) -> Diagnostic:
    own = [known for known, named in found.names.items() if _defines(found, named)]
    near = closest(name.text, own)
    helps = (Help(f"did you mean `{near}`?", (Edit(name.span, near),)),) if near else ()
    listed = ", ".join(f"`{known}`" for known in sorted(own)) or "nothing"
    return Diagnostic(
        "E0205",
        f"`{path}` has no `{name.text}`",
        name.span,
        "not defined there",
        helps=helps,
        notes=(f"it defines {listed}",),
    )


def _import_cycle(item: syntax.ImportNames | syntax.ImportModule, shown: str) -> Diagnostic:
    return Diagnostic(
        "E0206",
        f"`{shown}` imports itself",
        item.path_span,
        "this file is being read already",
        helps=(Help("move what both files need into a third one"),),
    )


def _cycle(first: Definition, members: list[Definition], needs: dict[str, dict[str, Span]]) -> Diagnostic:
    """The shortest way from a definition back to itself."""
    inside = {d.name for d in members}
    way = _way_back(first.name, inside, needs)
    labels = [Label(needs[a][b], f"needs `{b}`") for a, b in pairwise(way)]
    return Diagnostic(
        "E0206",
        f"`{first.name}` needs its own value",
        first.name_span,
        "defined by itself: " + " -> ".join(way),
        tuple(labels),
        (Help("break the circle: one of these needs a value that does not depend on the others"),),
    )


def _way_back(start: str, inside: set[str], needs: dict[str, dict[str, Span]]) -> list[str]:
    ways = [[start]]
    seen: set[str] = set()
    for way in ways:
        for use in needs[way[-1]]:
            if use == start:
                return [*way, start]
            if use in inside and use not in seen:
                seen.add(use)
                ways.append([*way, use])
    return [start, start]
