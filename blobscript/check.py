"""Types of whole programs: the third pass, from resolved names to the typed tree.

Definitions are checked when they are first needed, so their order does not matter; only functions
that call themselves must declare what they give. What fails keeps its name with a type that
absorbs, so one mistake gives one message, and all mistakes of a program are reported together.
Nothing is evaluated here.

Alongside, it is recorded who uses whom: a surface, light or field with a name that no item of the
main script leads to is never placed (W0402).

Non-goals: values (ranges, indexes, files but for their columns) are the evaluator's.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from blobscript import syntax, typed, wording
from blobscript.callables import Parameter, Signature
from blobscript.deep import deeply
from blobscript.diagnostics import Diagnostic, Edit, Help, Label
from blobscript.formulas import lambda_of
from blobscript.infer import Inference
from blobscript.names import type_of_syntax
from blobscript.resolve import Definition, Module, ModuleName, Program, told
from blobscript.scopes import Frame, Scope
from blobscript.source import Span
from blobscript.suggest import closest
from blobscript.types import (
    ANGLE,
    BOOL,
    ERROR,
    INT,
    KERNEL,
    NUMBER,
    RANGE,
    TEXT,
    Choice,
    ListOf,
    Type,
    article,
    describe,
    fits,
    has_error,
    join,
)

__all__ = ["Definitions", "check"]


def check(program: Program) -> tuple[typed.Program, list[Diagnostic]]:
    """The typed program and everything that is wrong with its types, in order of place."""
    definitions = Definitions(program)
    result = deeply(definitions.whole_program)
    return result, told(definitions.diagnostics, program.modules)


@dataclass(slots=True, eq=False)
class _Function:
    """`parameters`: known before the body is, for calls of a function to itself."""

    parameters: Signature | None = None
    signature: Signature | None = None
    function: typed.Function | None = None


_SCENE_ITEMS = ("surface", "field", "light", "camera", "background", "stage", "image", "animate")
_WAIVERS = ("crease", "nonmonotone", "unproved")


@dataclass(slots=True, eq=False)
class Definitions:
    """What is known about every definition of the program, found out on demand."""

    program: Program
    diagnostics: list[Diagnostic] = field(default_factory=list[Diagnostic])
    _inferences: dict[Module, Inference] = field(default_factory=dict[Module, Inference])
    _values: dict[Definition, typed.Value | typed.FileParam] = field(
        default_factory=dict[Definition, typed.Value | typed.FileParam]
    )
    _kernels: dict[Definition, typed.KernelFamily] = field(default_factory=dict[Definition, typed.KernelFamily])
    _functions: dict[Definition, _Function] = field(default_factory=dict[Definition, _Function])
    _formula_functions: dict[Definition, typed.FormulaFunction] = field(
        default_factory=dict[Definition, typed.FormulaFunction]
    )
    _aliases: dict[Definition, Type] = field(default_factory=dict[Definition, Type])
    _busy: set[Definition] = field(default_factory=set[Definition])
    _uses: dict[Definition | None, set[Definition]] = field(default_factory=dict[Definition | None, set[Definition]])
    _owner: Definition | None = None  # None: the items of the main script
    _recording: bool = True

    def report(self, diagnostic: Diagnostic) -> None:
        self.diagnostics.append(diagnostic)

    # ---- the program ------------------------------------------------------------------------

    def whole_program(self) -> typed.Program:
        """Of the standard library only what is used: its tests check the whole of it."""
        items: list[typed.Placed] = []
        for module in self.program.modules:
            for definition in () if module.is_standard else module.definitions:
                self._need(definition)
            items += self._items(module)
        order = [definition for module in self.program.modules for definition in module.definitions]
        values = [self._values.get(d) or self._kernels.get(d) for d in order]
        functions = {d: f.function for d, f in self._functions.items() if f.function is not None}
        return typed.Program(
            self.program.modules,
            tuple([value for value in values if value is not None]),
            functions,
            tuple(items),
            tuple(self._unplaced()),
        )

    def _items(self, module: Module) -> Iterator[typed.Placed]:
        """The items of a file; those of imported files are checked, but only assertions count."""
        main = module is self.program.main
        for item in module.items:
            scope = Scope(Frame())
            with self.only_checking(not main):
                element = self._inference(module).top_level(item, scope)
            if element is not None and (main or isinstance(element, (typed.Assert, typed.Debug))):
                yield typed.Placed(element, scope.frame.size)

    def _inference(self, module: Module) -> Inference:
        if module not in self._inferences:
            self._inferences[module] = Inference(module, self)
        return self._inferences[module]

    # ---- who uses whom ------------------------------------------------------------------------

    def use(self, definition: Definition) -> None:
        if self._recording:
            self._uses.setdefault(self._owner, set()).add(definition)

    @contextmanager
    def only_checking(self, really: bool = True) -> Generator[None]:
        """Uses in here (assertions) place nothing."""
        before, self._recording = self._recording, self._recording and not really
        try:
            yield
        finally:
            self._recording = before

    @contextmanager
    def _working_on(self, definition: Definition) -> Generator[None]:
        before = self._owner, self._recording
        self._owner, self._recording = definition, True
        self._busy.add(definition)
        try:
            yield
        finally:
            self._busy.discard(definition)
            self._owner, self._recording = before

    def _unplaced(self) -> Iterator[typed.Unplaced]:
        reached: set[Definition] = set()
        todo = list(self._uses.get(None, ()))
        while todo:
            definition = todo.pop()
            if definition not in reached:
                reached.add(definition)
                todo += self._uses.get(definition, ())
        for definition in self.program.main.definitions:
            value = self._values.get(definition)
            if isinstance(value, typed.Value) and definition not in reached and not definition.name.startswith("_"):
                kind = value.value.type
                kind = kind.element if isinstance(kind, ListOf) else kind
                if describe(kind) in _SCENE_ITEMS:
                    yield typed.Unplaced(definition.name, kind, definition.name_span)

    # ---- definitions --------------------------------------------------------------------------

    def _need(self, definition: Definition) -> None:
        match definition.node:
            case syntax.Let() | syntax.Param():
                self.value_type(definition, definition.name_span)
            case syntax.Fn() | syntax.KernelDecl():
                self.signature(definition, definition.name_span)
            case syntax.TypeAlias():
                self.alias(definition)

    def value_type(self, definition: Definition, span: Span) -> Type:
        """The type of a `let` or `param`."""
        if definition.failed:
            return ERROR
        if definition not in self._values:
            if definition in self._busy:
                return ERROR  # reported as a cycle, or below as one through a function
            with self._working_on(definition):
                self._values[definition] = self._value(definition)
        value = self._values[definition]
        return value.type if isinstance(value, typed.FileParam) else value.value.type

    def type_if_known(self, definition: Definition) -> Type | None:
        """The type of a value for suggestions, which must not start a check."""
        value = self._values.get(definition)
        if isinstance(value, typed.FileParam):
            return value.type
        return value.value.type if value else None

    def _value(self, definition: Definition) -> typed.Value | typed.FileParam:
        inference = self._inference(definition.module)
        scope = Scope(Frame())
        match definition.node:
            case syntax.Param() as node:
                return self._param(inference, definition, node, scope)
            case syntax.Let() as node:
                value = inference.let_value(node, scope)
                return typed.Value(definition, value, scope.frame.size)
            case _:
                raise AssertionError("only let and param have values")

    def alias(self, definition: Definition) -> Type:
        """The type that `type name = ...` stands for."""
        if definition.failed:
            return ERROR
        if definition not in self._aliases:
            assert isinstance(definition.node, syntax.TypeAlias)
            self._aliases[definition] = type_of_syntax(self._inference(definition.module), definition.node.type)
        return self._aliases[definition]

    # ---- parameters of the scene ----------------------------------------------------------------

    def _param(self, inference: Inference, definition: Definition, node: syntax.Param, scope: Scope) -> typed.FileParam:
        declared = type_of_syntax(inference, node.type) if node.type else None
        default = inference.expr(node.default, scope, declared)
        allowed = None
        if isinstance(node.allowed, syntax.Range):
            allowed = inference.range_(node.allowed, scope)
        elif node.allowed is not None:
            allowed = inference.expr(node.allowed, scope, ListOf(declared) if declared else None)
        step = inference.expr(node.step, scope, declared) if node.step else None
        kind = declared or _param_type(default, allowed, step)
        name = node.name.text
        default = inference.fit(node.default, default, kind, wording.Place(f"`{name}` is", " by default"))
        if step is not None and node.step is not None:
            step = inference.fit(node.step, step, kind, wording.Place(f"the step of `{name}` is"))
        limits, choices = None, None
        if isinstance(allowed, typed.Range) and isinstance(node.allowed, syntax.Range):
            limits = _limits(inference, node.allowed, allowed, kind, name)
        elif allowed is not None and node.allowed is not None:
            choices = inference.fit(
                node.allowed, allowed, ListOf(kind), wording.Place(f"`{name}` is chosen from", " behind `in`")
            )
            kind = _choice(kind, choices)
        group = self._group(inference, node)
        return typed.FileParam(definition, kind, default, limits, choices, step, group, node.doc, scope.frame.size)

    def _group(self, inference: Inference, node: syntax.Param) -> str:
        group = ""
        for attribute in node.attributes:
            if attribute.name.text != "group":
                self.report(_unknown_attribute(attribute, "group", "a param"))
            elif len(attribute.arguments) != 1:
                self.report(_attribute_wants(attribute, 'one text: @group("Head")'))
            else:
                value = attribute.arguments[0].value
                made = inference.fitted(value, Scope(Frame()), TEXT, wording.Place("`@group` wants"))
                group = str(made.value) if isinstance(made, typed.Constant) else group
        return group

    # ---- functions ------------------------------------------------------------------------------

    def signature(self, definition: Definition, span: Span) -> Signature:
        """How a function or kernel of a file is called; checks its body as well."""
        entry = self._functions.get(definition)
        if entry is None:
            entry = self._functions[definition] = _Function()
            with self._working_on(definition):
                if isinstance(definition.node, syntax.KernelDecl):
                    self._kernel(definition, definition.node, entry)
                else:
                    assert isinstance(definition.node, syntax.Fn)
                    self._function(definition, definition.node, entry)
        if entry.signature is None:
            if entry.parameters is None:
                self.report(_default_of_itself(definition, span))
                return Signature(definition.name, (), ERROR, definition.name)
            self._undeclared(definition, span)
            entry.signature = entry.parameters
        return entry.signature

    def is_incomplete(self, definition: Definition) -> bool:
        """Are the parameters of this function just being looked at?"""
        return self._functions[definition].signature is None

    def _function(self, definition: Definition, node: syntax.Fn, entry: _Function) -> None:
        inference = self._inference(definition.module)
        for attribute in node.attributes:
            self.report(_unknown_attribute(attribute, None, "a function"))
        scope = Scope(Frame())
        parameters = [inference.parameter(p, scope, None) for p in node.parameters]
        result = type_of_syntax(inference, node.result) if node.result else None
        entry.parameters = _signature(node, parameters, result or ERROR)
        if result is not None:
            entry.signature = entry.parameters
        statements = [inference.statement(s, scope) for s in node.statements if not isinstance(s, syntax.Error)]
        body = inference.expr(node.body, scope, result)
        if result is not None:
            place = wording.Place(f"`{node.name.text}` is declared to give", labels=_declared_at(node))
            body = inference.fit(node.body, body, result, place)
        if entry.signature is None or result is None:
            entry.signature = _signature(node, parameters, body.type)
        entry.function = typed.Function(
            node.name.text, tuple(parameters), typed.Body(tuple(statements), body), scope.frame.size, node.span
        )

    def _undeclared(self, definition: Definition, span: Span) -> None:
        node = definition.node
        at = node.name.span.at_end
        if isinstance(node, syntax.Fn):
            text = node.span.source.text
            close = text.rfind(")", node.name.span.end, node.body.span.start) + 1
            at = Span(node.span.source, close, close) if close else at
        self.report(
            Diagnostic(
                "E0305",
                f"`{definition.name}` calls itself, so it must declare what it gives",
                definition.name_span,
                "the type of the result is missing",
                (Label(span, "calls itself here"),) if span != definition.name_span else (),
                (Help("write the type of the result behind the parameters", (Edit(at, " -> number"),)),),
            )
        )

    # ---- kernels --------------------------------------------------------------------------------

    def _kernel(self, definition: Definition, node: syntax.KernelDecl, entry: _Function) -> None:
        inference = self._inference(definition.module)
        scope = Scope(Frame())
        parameters = self._kernel_parameters(inference, node, scope)
        entry.signature = Signature(
            node.name.text,
            tuple([Parameter(p.name, p.type, p.default is not None) for p in parameters]),
            KERNEL,
            f"{node.name.text}({', '.join([_written(p) for p in node.parameters[1:]])}) -> kernel",
        )
        inference.fitted(node.body, scope, NUMBER, wording.Place(f"the kernel `{node.name.text}` is"))
        constants = self._constants(definition)
        variable = node.parameters[0].name.text if node.parameters else "r"
        self._kernels[definition] = typed.KernelFamily(
            definition,
            variable,
            tuple(parameters),
            constants,
            self._formulas(definition),
            tuple(self._waivers(node)),
        )

    def _kernel_parameters(self, inference: Inference, node: syntax.KernelDecl, scope: Scope) -> list[typed.Parameter]:
        if not node.parameters:
            self.report(
                Diagnostic(
                    "E0302",
                    f"the kernel `{node.name.text}` needs a variable",
                    node.name.span,
                    "what stands for the distance?",
                    helps=(Help("write it first", (Edit(node.name.span, f"{node.name.text}(r)"),)),),
                )
            )
            return []
        inference.parameter(node.parameters[0], scope, NUMBER)
        parameters = [inference.parameter(p, scope, NUMBER) for p in node.parameters[1:]]
        for parameter, written in zip(parameters, node.parameters[1:], strict=True):
            if not fits(parameter.type, NUMBER):
                place = wording.Place("parameters of kernels are numbers: this is")
                self.report(
                    wording.mismatch(syntax.Name(parameter.name, written.name.span), parameter.type, NUMBER, place)
                )
        return parameters

    def _constants(self, definition: Definition) -> tuple[tuple[str, typed.Expr], ...]:
        """The numbers and conditions of the file that the body of a kernel, or a function in it, uses."""
        found: list[tuple[str, typed.Expr]] = []
        for name, used in self._used(definition):
            if isinstance(used.node, (syntax.Let, syntax.Param)):
                kind = self.value_type(used, used.name_span)
                if (fits(kind, NUMBER) or fits(kind, BOOL)) and not has_error(kind):
                    found.append((name, typed.Global(used, kind, used.name_span)))
        return tuple(found)

    def _formulas(self, definition: Definition) -> tuple[tuple[str, typed.FormulaFunction], ...]:
        """The functions of the file that the body of a kernel, or a function in it, calls."""
        return tuple([(name, self._formula(used)) for name, used in self._used(definition) if _is_function(used)])

    def _formula(self, definition: Definition) -> typed.FormulaFunction:
        if definition not in self._formula_functions:
            ends = not definition.recursive
            self._formula_functions[definition] = typed.FormulaFunction(
                definition, self._constants(definition) if ends else (), self._formulas(definition) if ends else ()
            )
        return self._formula_functions[definition]

    def _used(self, definition: Definition) -> list[tuple[str, Definition]]:
        """What a definition uses, each with the words that mean it in its file."""
        words: dict[Definition, str] = {}
        for name, named in definition.module.names.items():
            if isinstance(named, Definition):
                words[named] = name
            elif isinstance(named, ModuleName):
                words |= {own: f"{name}.{own.name}" for own in named.module.definitions}
        return sorted([(words[used], used) for used in self._uses.get(definition, ())], key=lambda pair: pair[0])

    def _waivers(self, node: syntax.KernelDecl) -> Iterator[str]:
        for attribute in node.attributes:
            if attribute.name.text != "allow":
                self.report(_unknown_attribute(attribute, "allow", "a kernel"))
                continue
            if not attribute.arguments:
                self.report(_attribute_wants(attribute, "what it allows: @allow(crease)"))
            for argument in attribute.arguments:
                if isinstance(argument.value, syntax.Name) and argument.value.text in _WAIVERS:
                    yield argument.value.text
                else:
                    self.report(_unknown_waiver(argument))

    # ---- files of records -------------------------------------------------------------------------

    def record_type(self, file: str, module: Module, span: Span, file_span: Span) -> Type:
        """The type of the records in a file, from its columns."""
        from blobscript.columns import type_of_table
        from blobscript.data import read_records
        from blobscript.values import Context, MakerError

        context = Context(span, module.source.folder, self.program.main.source.folder)
        try:
            return ListOf(type_of_table(read_records(context, file)))
        except MakerError as error:
            place = file_span if error.argument == "file" else span
            self.report(Diagnostic(error.code, error.message, place, error.label, helps=error.helps, notes=error.notes))
            return ListOf(ERROR)


def _is_function(definition: Definition) -> bool:
    """Written as one: what else has a function as its value cannot be read as a formula."""
    node = definition.node
    return isinstance(node, syntax.Fn) or (isinstance(node, syntax.Let) and lambda_of(node.value) is not None)


# ---- signatures in words ------------------------------------------------------------------------


def _signature(node: syntax.Fn, parameters: list[typed.Parameter], result: Type) -> Signature:
    made = [
        Parameter(p.name, p.type, p.default is not None, written.named_only)
        for p, written in zip(parameters, node.parameters, strict=True)
    ]
    texts: list[str] = []
    for written in node.parameters:
        if written.named_only and "*" not in texts:
            texts.append("*")
        texts.append(_written(written))
    gives = "" if has_error(result) else f" -> {describe(result)}"
    return Signature(node.name.text, tuple(made), result, f"{node.name.text}({', '.join(texts)}){gives}")


def _written(node: syntax.Parameter) -> str:
    return " ".join(node.span.text.split())


def _declared_at(node: syntax.Fn) -> tuple[Label, ...]:
    return (Label(node.result.span, "declared here"),) if node.result else ()


# ---- types of parameters --------------------------------------------------------------------------


def _param_type(default: typed.Expr, allowed: typed.Expr | None, step: typed.Expr | None) -> Type:
    """An int only if everything that is written is one."""
    kind = default.type
    parts: list[Type] = [step.type] if step else []
    if isinstance(allowed, typed.Range):
        parts += [allowed.lo.type, allowed.hi.type]
    elif allowed is not None and isinstance(allowed.type, ListOf):
        parts.append(allowed.type.element)
    for part in parts:
        kind = join(kind, part) or kind
    return kind


def _default_of_itself(definition: Definition, span: Span) -> Diagnostic:
    return Diagnostic(
        "E0206",
        f"a default value of `{definition.name}` calls `{definition.name}` itself",
        span,
        "this default would need its own value",
        (Label(definition.name_span, "the function"),),
        (Help("give a default that can be computed without the function"),),
    )


def _limits(
    inference: Inference, node: syntax.Range, allowed: typed.Range, kind: Type, name: str
) -> typed.Range | None:
    if not (fits(kind, NUMBER) or kind == ANGLE):
        if not has_error(kind):
            inference.report(
                Diagnostic(
                    "E0304",
                    f"a range is for numbers and angles, but `{name}` is {article(kind)}",
                    node.span,
                    "range",
                    helps=(Help("list what is allowed: in [a, b, c]"),),
                )
            )
        return None
    place = wording.Place(f"the range of `{name}` wants")
    lo = inference.fit(node.lo, allowed.lo, kind, place)
    hi = allowed.hi if isinstance(lo, typed.Failed) else inference.fit(node.hi, allowed.hi, kind, place)
    return typed.Range(lo, hi, allowed.half_open, ListOf(INT) if kind == INT else RANGE, allowed.span)


def _choice(kind: Type, choices: typed.Expr) -> Type:
    """A text from a list that is written out is a choice, so that comparisons can be checked."""
    if kind != TEXT or not isinstance(choices, typed.List):
        return kind
    texts: list[str] = []
    for element in choices.elements:
        if not (isinstance(element, typed.Item) and isinstance(element.value, typed.Constant)):
            return kind
        texts.append(str(element.value.value))
    return Choice(tuple(texts)) if texts else kind


# ---- attributes -------------------------------------------------------------------------------------

_ATTRIBUTES: Mapping[str, str] = {"group": "a param", "allow": "a kernel"}


def _unknown_attribute(attribute: syntax.Attribute, wanted: str | None, before: str) -> Diagnostic:
    name = attribute.name.text
    if name in _ATTRIBUTES:
        return Diagnostic(
            "E0303", f"`@{name}` stands before {_ATTRIBUTES[name]}, not before {before}", attribute.span, "not here"
        )
    near = closest(name, _ATTRIBUTES) or wanted
    helps = (Help(f"did you mean `@{near}`?", (Edit(attribute.name.span, near),)),) if near else ()
    return Diagnostic("E0201", f"there is no attribute `@{name}`", attribute.name.span, "unknown", helps=helps)


def _attribute_wants(attribute: syntax.Attribute, what: str) -> Diagnostic:
    return Diagnostic("E0302", f"`@{attribute.name.text}` wants {what}", attribute.span, "incomplete")


def _unknown_waiver(argument: syntax.Argument) -> Diagnostic:
    text = argument.value.span.text
    near = closest(text, _WAIVERS)
    return Diagnostic(
        "E0303",
        f"`@allow` knows no `{text}`",
        argument.span,
        "unknown",
        helps=(Help(f"did you mean `{near}`?", (Edit(argument.span, near),)),) if near else (),
        notes=("it knows " + ", ".join(f"`{waiver}`" for waiver in _WAIVERS),),
    )
