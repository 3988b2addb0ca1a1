"""The typed tree as Python closures: what runs when a script is evaluated.

`Compiler.expr` turns an expression into a function of the frame (the list of a call's slots).
Values are plain Python: floats, ints, bools, texts, 3-tuples, dicts for records, lists, ranges and
arrays for lists, and the classes of `values` for what the makers make.

Invariant: every closure that calls itself through others does so from Python code to Python code,
so a deep recursion of the script takes frames of the interpreter and no C stack (`deep`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, assert_never

import numpy as np

from blobscript import typed
from blobscript.assertions import assertion
from blobscript.builtins import FUNCTIONS, LIST_FUNCTIONS
from blobscript.coerce import coercion, records
from blobscript.diagnostics import Diagnostic, Label
from blobscript.instances import Instances
from blobscript.makers import MAKERS
from blobscript.operators import IMPLEMENTATIONS, BadNumberError, plain
from blobscript.parts import count_blobs, count_parts
from blobscript.resolve import Definition
from blobscript.runtime import (
    MISSING,
    POISON,
    AbsorbedError,
    Code,
    FailureError,
    Frame,
    FunctionValue,
    Origin,
    Run,
    State,
    too_deep,
)
from blobscript.shown import show, show_quoted
from blobscript.signatures import BUILTINS
from blobscript.source import Span
from blobscript.types import VEC3, ListOf, RecordOf, describe
from blobscript.values import Context, MakerError, Surface

__all__ = ["Compiler"]

Emit = Callable[[Frame, list[Any]], None]

_LONGEST_TEXT = 1_000_000

#: Between what a node costs and what a call costs; larger: large bodies run for long on few steps.
_NODES_PER_STEP = 32

#: Functions that cost as much as so many nodes; the others are worth 4.
_WEIGHTS: Mapping[str, int] = {"noise": 64, "rand": 8, "oklch": 16, "hsl": 16, "rgb": 8, "normalize": 8}

#: Makers that look at every pair of edges or faces that come near each other.
_STEPS_PER_POINT: Mapping[str, int] = {"polygon": 100, "polyhedron": 10, "mesh": 10}


@dataclass(slots=True, eq=False)
class Compiler:
    """Compiles the expressions of one program. `cells`: the value of each definition, once known."""

    program: typed.Program
    state: State
    instances: Instances
    cells: dict[Definition, list[Any]] = field(default_factory=dict[Definition, list[Any]])
    nodes: int = 0  # compiled so far; the difference around a body is its size
    _codes: dict[Definition, Code] = field(default_factory=dict[Definition, Code])

    # ---- expressions ----------------------------------------------------------------------

    def expr(self, node: typed.Expr) -> Run:
        self.nodes += 1
        match node:
            case typed.Constant(value):
                return lambda frame: value
            case typed.Local(slot):
                return lambda frame: frame[slot]
            case typed.Global(definition):
                return self._global(definition)
            case typed.FunctionValue():
                return self._function_value(node)
            case typed.Text():
                return self._text(node)
            case typed.Vector(x, y, z):
                return _vector(self.expr(x), self.expr(y), self.expr(z))
            case typed.Record(fields):
                parts = [(name, self.expr(value)) for name, value in fields]
                return lambda frame: {name: part(frame) for name, part in parts}
            case typed.List():
                return self._list(node)
            case typed.Unary():
                return self._unary(node)
            case typed.Binary():
                return self._binary(node)
            case typed.And(left, right):
                first, second = self.expr(left), self.expr(right)
                return lambda frame: first(frame) and second(frame)
            case typed.Or(left, right):
                first, second = self.expr(left), self.expr(right)
                return lambda frame: first(frame) or second(frame)
            case typed.Not(operand):
                run = self.expr(operand)
                return lambda frame: not run(frame)
            case typed.Range():
                return self._range(node)
            case typed.If(condition, then, otherwise):
                test, yes, no = self.expr(condition), self.expr(then), self.expr(otherwise)
                return lambda frame: yes(frame) if test(frame) else no(frame)
            case typed.Lambda():
                return self._lambda(node)
            case typed.CallFunction():
                return self._call_function(node)
            case typed.CallValue():
                return self._call_value(node)
            case typed.CallBuiltin():
                return self._call_builtin(node)
            case typed.CallKernel():
                return self._call_kernel(node)
            case typed.Field():
                return self._field(node)
            case typed.Index():
                return self._index(node)
            case typed.Convert():
                return self._convert(node)
            case typed.Failed():
                raise AssertionError("a program with errors is not evaluated")
            case _:
                assert_never(node)

    def _global(self, definition: Definition) -> Run:
        cell = self.cells.setdefault(definition, [POISON])

        def run(frame: Frame) -> Any:
            value = cell[0]
            if value is POISON:
                raise AbsorbedError
            return value

        return run

    def _text(self, node: typed.Text) -> Run:
        parts = [
            (part, None, None) if isinstance(part, str) else ("", self.expr(part), part.type) for part in node.parts
        ]
        state, span = self.state, node.span

        def run(frame: Frame) -> str:
            made = [text if part is None or kind is None else show(part(frame), kind) for text, part, kind in parts]
            text = "".join(made)
            if len(text) > _LONGEST_TEXT:
                raise _failure("E0405", "this text is too long (the limit is a million characters)", span)
            state.spend(len(text) // 4, span)
            return text

        return run

    def _unary(self, node: typed.Unary) -> Run:
        operand, implementation = self.expr(node.operand), IMPLEMENTATIONS[node.implementation]
        return lambda frame: implementation(operand(frame))

    def _binary(self, node: typed.Binary) -> Run:
        left, right = self.expr(node.left), self.expr(node.right)
        if node.implementation in _DIRECT:
            return _DIRECT[node.implementation](left, right)
        if node.op in ("==", "!=") and isinstance(node.left.type, (ListOf, RecordOf)):
            return self._compare_lists(node, left, right)
        implementation = IMPLEMENTATIONS[node.implementation]

        def run(frame: Frame) -> Any:
            a = left(frame)
            b = right(frame)
            try:
                return implementation(a, b)
            except BadNumberError as error:
                raise _arithmetic(error, node, a, b) from None

        return run

    def _compare_lists(self, node: typed.Binary, left: Run, right: Run) -> Run:
        implementation, state = IMPLEMENTATIONS[node.implementation], self.state

        def run(frame: Frame) -> bool:
            a, b = left(frame), right(frame)
            state.spend(len(a), node.span)
            return implementation(a, b)

        return run

    def _range(self, node: typed.Range) -> Run:
        lo, hi, extra, state = self.expr(node.lo), self.expr(node.hi), not node.half_open, self.state

        def run(frame: Frame) -> range:
            made = range(lo(frame), hi(frame) + extra)
            if len(made) > state.budget:
                state.exhausted(node.span)
            return made

        return run

    def _field(self, node: typed.Field) -> Run:
        target, name = self.expr(node.target), node.name
        if node.target.type == VEC3:
            index = "xyz".index(name)
            return lambda frame: target(frame)[index]
        return lambda frame: target(frame)[name]

    def _index(self, node: typed.Index) -> Run:
        target, index = self.expr(node.target), self.expr(node.index)

        def run(frame: Frame) -> Any:
            values, at = target(frame), index(frame)
            if not 0 <= at < len(values):
                raise _outside(node, at, len(values))
            value = values[at]
            if isinstance(value, np.ndarray):
                return tuple(value.tolist())
            return value.item() if isinstance(value, np.generic) else value  # pyright: ignore[reportUnknownVariableType]

        return run

    def _convert(self, node: typed.Convert) -> Run:
        value, change, state = self.expr(node.value), coercion(node.value.type, node.type), self.state
        if change is None:
            return value
        if not isinstance(node.type, ListOf):
            return lambda frame: change(value(frame))

        def run(frame: Frame) -> Any:
            values = value(frame)
            state.spend_on_list(values, node.span)
            return change(values)

        return run

    # ---- lists and blocks -----------------------------------------------------------------

    def _list(self, node: typed.List) -> Run:
        column = self._column(node)
        if column is not None:
            return column
        if all(isinstance(element, typed.Item) for element in node.elements):
            return self._plain_list(node.elements)
        emit = self.elements(node.elements)

        def run(frame: Frame) -> list[Any]:
            out: list[Any] = []
            emit(frame, out)
            return out

        return run

    def _plain_list(self, elements: Sequence[typed.Element]) -> Run:
        """Of items alone; what is wrong with several of them is told together."""
        plain_items = [element for element in elements if isinstance(element, typed.Item)]
        items = [self.expr(element.value) for element in plain_items]
        state = self.state

        def run(frame: Frame) -> list[Any]:
            out: list[Any] = []
            depth = state.depth
            try:
                for item in items:
                    out.append(item(frame))  # and `out` tells which one failed
            except (FailureError, AbsorbedError) as failure:
                rest = [(element, self._item(element)) for element in plain_items[len(out) :]]
                raise self._with_others(failure, rest, frame, depth) from None
            return out

        return run

    def _column(self, node: typed.List) -> Run | None:
        """`[for (row in rows) row.name]`: of records from a file it is an array already."""
        match node.elements:
            case (typed.For(None, slot, iterable, (typed.Item(typed.Field(typed.Local(own), name)),)),) if own == slot:
                through, plainly = self.expr(iterable), self.elements(node.elements)
            case _:
                return None

        def run(frame: Frame) -> Any:
            values = through(frame)
            column = getattr(values, "column", None)
            if column is not None:
                return column(name)
            out: list[Any] = []
            plainly(frame, out)
            return out

        return run

    def elements(self, elements: Sequence[typed.Element], item: Callable[[typed.Item], Emit] | None = None) -> Emit:
        """Appends what the elements give. `item`: how a plain item is appended."""
        emits = [self._element(element, item) for element in elements]
        if len(emits) == 1:
            return emits[0]

        state = self.state

        def emit(frame: Frame, out: list[Any]) -> None:
            depth = state.depth
            for number, one in enumerate(emits):
                try:
                    one(frame, out)
                except (FailureError, AbsorbedError) as failure:
                    rest = list(zip(elements, emits, strict=True))[number:]
                    raise self._with_others(failure, rest, frame, depth) from None

        return emit

    def _with_others(
        self,
        failure: FailureError | AbsorbedError,
        rest: Sequence[tuple[typed.Element, Emit]],
        frame: Frame,
        depth: int,
    ) -> FailureError | AbsorbedError:
        """The mistake of the first of these elements, and those of the others up to a name that fails.

        depth: of the calls around.
        """
        found, state = failure, self.state
        for element, emit in rest[1:]:
            if isinstance(rest[0][0], typed.Let) or _is_final(found) or state.steps < 0:
                break
            state.depth = depth
            try:
                emit(frame, [])
            except FailureError as other:
                if isinstance(found, FailureError):
                    found.join(other)
                else:
                    found = other
                if isinstance(element, typed.Let):
                    break
            except AbsorbedError:
                if isinstance(element, typed.Let):
                    break
        return found

    def _element(self, element: typed.Element, item: Callable[[typed.Item], Emit] | None) -> Emit:
        match element:
            case typed.Item():
                return (item or self._item)(element)
            case typed.Spread():
                return self._spread(element, item is not None)
            case typed.For():
                return self._for(element, item)
            case typed.IfElements(condition, then, otherwise):
                test, yes, no = self.expr(condition), self.elements(then, item), self.elements(otherwise, item)
                return lambda frame, out: yes(frame, out) if test(frame) else no(frame, out)
            case typed.Let() | typed.Assert() | typed.Debug():
                statement = self.statement(element)
                return lambda frame, out: statement(frame)
            case _:
                assert_never(element)

    def _item(self, element: typed.Item) -> Emit:
        value = self.expr(element.value)

        def emit(frame: Frame, out: list[Any]) -> None:
            out.append(value(frame))

        return emit

    def _spread(self, element: typed.Spread, placing: bool) -> Emit:
        value, state, span = self.expr(element.value), self.state, element.span

        def emit(frame: Frame, out: list[Any]) -> None:
            values = value(frame)
            state.spend(len(values), span)
            out.extend([(one, None, span) for one in plain(values)] if placing else plain(values))

        return emit

    def _for(self, element: typed.For, item: Callable[[typed.Item], Emit] | None) -> Emit:
        through, state, span = self.expr(element.iterable), self.state, element.iterable.span
        before = self.nodes
        body, slot, index = self.elements(element.body, item), element.slot, element.index_slot
        steps = self._steps(before)

        def emit(frame: Frame, out: list[Any]) -> None:
            values = through(frame)
            state.spend(len(values) * steps, span)
            for value in plain(values):
                frame[slot] = value
                body(frame, out)

        if index is None:
            return emit

        def emit_numbered(frame: Frame, out: list[Any]) -> None:
            values = through(frame)
            state.spend(len(values) * steps, span)
            for i, value in enumerate(plain(values)):
                frame[index] = i
                frame[slot] = value
                body(frame, out)

        return emit_numbered

    # ---- statements -----------------------------------------------------------------------

    def statement(self, node: typed.Statement) -> Callable[[Frame], None]:
        match node:
            case typed.Let(slot, _, value):
                run = self.expr(value)

                def assign(frame: Frame) -> None:
                    frame[slot] = run(frame)

                return assign
            case typed.Assert():
                return assertion(self, node)
            case typed.Debug(value, span):
                shown = self.expr(value)

                def tell(frame: Frame) -> None:
                    text = show_quoted(shown(frame), value.type)
                    message = f"{value.span.text} = {text}" if "\n" not in value.span.text else text
                    self.state.notes.append(Diagnostic("N0701", message, span, f"{describe(value.type)}: {text}"))

                return tell
            case _:
                assert_never(node)

    # ---- functions ------------------------------------------------------------------------

    def code(self, definition: Definition) -> Code:
        """The compiled function of a file; its body is compiled once, when first called for."""
        if definition not in self._codes:
            function = self.program.functions[definition]
            made = self._codes[definition] = Code(f"`{function.name}`", _tail(function))
            before = self.nodes
            made.body = self._body(function)
            made.steps = self._steps(before)
        return self._codes[definition]

    def _steps(self, before: int) -> int:
        """What running once through the nodes since then costs."""
        return 1 + (self.nodes - before) // _NODES_PER_STEP

    def _body(self, function: typed.Function) -> Run:
        defaults = [(i, self.expr(p.default)) for i, p in enumerate(function.parameters) if p.default is not None]
        statements = [self.statement(statement) for statement in function.body.statements]
        result = self.expr(function.body.result)
        if not defaults and not statements:
            return result

        def run(frame: Frame) -> Any:
            for slot, default in defaults:
                if frame[slot] is MISSING:
                    frame[slot] = default(frame)
            for statement in statements:
                statement(frame)
            return result(frame)

        return run

    def _call_function(self, node: typed.CallFunction) -> Run:
        code, state, span = self.code(node.definition), self.state, node.span
        arguments = [self.expr(a) if a is not None else _missing for a in node.arguments]
        tail, name, limit = code.tail, code.name, self.state.depth_limit

        def run(frame: Frame) -> Any:
            inner = [argument(frame) for argument in arguments]
            inner += tail
            state.steps -= code.steps
            if state.steps < 0:
                state.exhausted(span)
            state.depth += 1
            if state.depth > limit:
                raise too_deep(name, span, state)
            try:
                result = code.body(inner)
            except FailureError as failure:
                failure.through(span, name)
                raise
            state.depth -= 1
            return result

        return run

    def _lambda(self, node: typed.Lambda) -> Run:
        function = node.function
        count, before = len(function.parameters), self.nodes
        body, captured = self._body(function), node.captured
        call = self._value_caller(function.name, node.span, self._steps(before))
        column = _column_of(function)
        empty = _tail(function)

        def run(frame: Frame) -> FunctionValue:
            tail = list(empty)
            for outer, inner in captured:
                tail[inner - count] = frame[outer]
            return FunctionValue(call(body, tail), column, Origin(function, tail, self.cells, self.program))

        return run

    def _value_caller(self, name: str, span: Span, steps: int = 1) -> Callable[[Run, Frame], Callable[[Frame], Any]]:
        """Makes the call of a function value: a step, a level deeper."""
        state, limit = self.state, self.state.depth_limit

        def make(body: Run, tail: Frame) -> Callable[[Frame], Any]:
            def call(arguments: Frame) -> Any:
                arguments += tail
                state.steps -= steps
                if state.steps < 0:
                    state.exhausted(span)
                state.depth += 1
                if state.depth > limit:
                    raise too_deep(name, span, state)
                result = body(arguments)
                state.depth -= 1
                return result

            return call

        return make

    def _function_value(self, node: typed.FunctionValue) -> Run:
        if node.definition is not None:
            return self._named_function(node, node.definition)
        assert node.builtin is not None
        names = [p.name for p in node.builtin.positional]
        locals_ = [typed.Local(i, name, node.type, node.span) for i, name in enumerate(names)]
        pairs = tuple(zip(names[: len(node.type.parameters)], locals_, strict=False))
        run = self.expr(typed.CallBuiltin(node.builtin.name, pairs, node.type, node.span))
        value = FunctionValue(run, origin=Origin(None, [], self.cells, self.program, node.builtin))
        return lambda frame: value

    def _named_function(self, node: typed.FunctionValue, definition: Definition) -> Run:
        code, count = self.code(definition), len(self.program.functions[definition].parameters)
        call = self._value_caller(code.name, node.span)

        def body(frame: Frame) -> Any:
            return code.body(frame)

        def enter(arguments: Frame) -> Any:
            missing = [MISSING] * (count - len(arguments))
            return made(arguments + missing)

        made = call(body, code.tail)
        function = self.program.functions[definition]
        value = FunctionValue(enter, origin=Origin(function, _tail(function), self.cells, self.program))
        return lambda frame: value

    def _call_value(self, node: typed.CallValue) -> Run:
        callee, span = self.expr(node.callee), node.span
        arguments = [self.expr(argument) for argument in node.arguments]

        def run(frame: Frame) -> Any:
            function = callee(frame)
            inner = [argument(frame) for argument in arguments]
            try:
                return function.call(inner)
            except FailureError as failure:
                failure.through(span, "a function value")
                raise

        return run

    # ---- built-ins ------------------------------------------------------------------------

    def _call_builtin(self, node: typed.CallBuiltin) -> Run:
        name, state = node.name, self.state
        self.nodes += _WEIGHTS.get(name, 4)
        names = [own for own, _ in node.arguments]
        if name in ("time", "phase"):
            return lambda frame: getattr(state, name)
        if name in LIST_FUNCTIONS and "children" not in names:
            return self._call_list_function(node)
        if name in FUNCTIONS and not (name == "floor" and "x" not in names):  # `floor()` is a thing of the scene
            return self._call_plain(node, FUNCTIONS[name])
        if name == "pi":
            return lambda frame: float(np.pi)
        if name in self.instances.built_in:
            return self._call_maker(node, self.instances.built_in[name])
        return self._call_maker(node, MAKERS[name])

    def _call_plain(self, node: typed.CallBuiltin, function: Callable[..., Any]) -> Run:
        arguments = [self.expr(value) for _, value in node.arguments]
        if len(arguments) == 1:
            return _one_argument(function, arguments[0], node)

        def run(frame: Frame) -> Any:
            values = [argument(frame) for argument in arguments]
            try:
                return function(*values)
            except BadNumberError as error:
                raise _no_result(error, node) from None

        return run

    def _call_list_function(self, node: typed.CallBuiltin) -> Run:
        """max, min, map and their kin: the list is the first argument, or `first` and `rest`."""
        function, state, span = LIST_FUNCTIONS[node.name], self.state, node.span
        arguments = dict(node.arguments)
        if "first" in arguments:
            parts = [arguments["first"]]
            rest = arguments.get("rest")
            elements = [typed.Item(parts[0], span), *([typed.Spread(rest, span)] if rest else [])]
            runs = [self.expr(typed.List(tuple(elements), ListOf(parts[0].type), span))]
        else:
            runs = [self.expr(value) for value in arguments.values()]
        first, others = runs[0], runs[1:]

        def run(frame: Frame) -> Any:
            values = first(frame)
            state.spend_on_list(values, span)
            more = [other(frame) for other in others]
            try:
                if len(more) == 1:  # not `*more`: that would take C stack, and `map` can be deep in a recursion
                    return function(values, more[0])
                return function(values, more[0], more[1]) if more else function(values)
            except BadNumberError as error:
                raise _no_result(error, node) from None

        return run

    def _call_maker(self, node: typed.CallBuiltin, maker: Callable[..., Any]) -> Run:
        """A call of a maker: a step, with the places and the folder of the call in the context (the
        places of its arguments are for warnings)."""
        state, span, context = self.state, node.span, self.state.context
        fixed = {name: value.value for name, value in node.arguments if isinstance(value, typed.Constant)}
        varying = [(name, self.expr(v)) for name, v in node.arguments if not isinstance(v, typed.Constant)]
        folder = span.source.folder
        root = self.program.main.source.folder if folder is not None else None
        spans = {name: value.span for name, value in node.arguments}
        lists = [name for name, value in node.arguments if isinstance(value.type, ListOf)]
        each = _STEPS_PER_POINT.get(node.name, 1)
        if "file" in spans:
            maker = _reading_once(node, maker, state)
        elif BUILTINS[node.name].kind == "query":
            maker = _charged(maker, state)

        def run(frame: Frame) -> Any:
            arguments = dict(fixed)
            for name, value in varying:
                arguments[name] = value(frame)
            state.steps -= 1
            if state.steps < 0:
                state.exhausted(span)
            for name in lists:
                state.spend_on_list(arguments[name], span, each)
            context.span, context.folder, context.root, context.places = span, folder, root, spans
            try:
                return maker(context, **arguments)
            except MakerError as error:
                raise _maker_failure(error, span, spans) from None

        return run

    def _call_kernel(self, node: typed.CallKernel) -> Run:
        arguments = [(name, self.expr(value)) for name, value in node.arguments]
        return self.instances.maker(self, node.definition, arguments)


# ---- the shapes that are hot -------------------------------------------------------------------


def _missing(frame: Frame) -> Any:
    return MISSING


def _tail(function: typed.Function) -> Frame:
    return [None] * (function.size - len(function.parameters))


def _column_of(function: typed.Function) -> str | None:
    """The name, if the function only takes a field of a record: `fn(row) = row.name`."""
    match function.body:
        case typed.Body((), typed.Field(typed.Local(0), name)) if len(function.parameters) == 1:
            return name
        case _:
            return None


def _vector(x: Run, y: Run, z: Run) -> Run:
    return lambda frame: (x(frame), y(frame), z(frame))


def _one_argument(function: Callable[[Any], Any], argument: Run, node: typed.CallBuiltin) -> Run:
    def run(frame: Frame) -> Any:
        value = argument(frame)
        try:
            return function(value)
        except BadNumberError as error:
            raise _no_result(error, node) from None

    return run


#: Operators that cannot fail, without the detour.
_DIRECT: Mapping[str, Callable[[Run, Run], Run]] = {
    "add": lambda a, b: lambda frame: a(frame) + b(frame),
    "subtract": lambda a, b: lambda frame: a(frame) - b(frame),
    "multiply": lambda a, b: lambda frame: a(frame) * b(frame),
    "less": lambda a, b: lambda frame: a(frame) < b(frame),
    "less_equal": lambda a, b: lambda frame: a(frame) <= b(frame),
    "greater": lambda a, b: lambda frame: a(frame) > b(frame),
    "greater_equal": lambda a, b: lambda frame: a(frame) >= b(frame),
}


# ---- makers that need more than a step -----------------------------------------------------------


def _reading_once(node: typed.CallBuiltin, maker: Callable[..., Any], state: State) -> Callable[..., Any]:
    """A file is read once however often it is asked for; records become what the script declares."""
    shape = records(node.type) if node.name == "read_records" else None

    def read(context: Context, file: str, **others: Any) -> Any:
        key = (f"{node.name} {others}", context.folder, file)
        if key not in state.files:
            state.files[key] = maker(context, file=file, **others)
        return shape(state.files[key]) if shape else state.files[key]

    return read


def _charged(maker: Callable[..., Any], state: State) -> Callable[..., Any]:
    """Queries go through all blobs of a surface, and solve it when it is first asked about."""

    def ask(context: Context, surface: Surface, **others: Any) -> Any:
        known = context.memory.get(id(surface))
        if known is None:
            state.spend(2 * count_parts([surface], bulk=32), context.span)
        else:
            state.spend(count_blobs(known[1].field) >> 5, context.span)
        return maker(context, surface=surface, **others)

    return ask


# ---- what goes wrong -----------------------------------------------------------------------------


def _is_final(failure: FailureError | AbsorbedError) -> bool:
    """Beyond the budget nothing else is tried."""
    return isinstance(failure, FailureError) and failure.diagnostic.code == "E0901"


def _failure(code: str, message: str, span: Span, label: str = "") -> FailureError:
    return FailureError(Diagnostic(code, message, span, label))


def _arithmetic(error: BadNumberError, node: typed.Binary, a: Any, b: Any) -> FailureError:
    labels = [
        Label(side.span, f"this is {show(value, side.type)}")
        for side, value in ((node.left, a), (node.right, b))
        if not isinstance(side, typed.Constant)
    ]
    return FailureError(Diagnostic(error.code, error.what, node.span, "", tuple(labels)))


def _no_result(error: BadNumberError, node: typed.CallBuiltin) -> FailureError:
    return FailureError(Diagnostic(error.code, error.what, node.span))


def _outside(node: typed.Index, at: int, length: int) -> FailureError:
    holds = "the list is empty" if length == 0 else f"the list has {length} elements, 0 to {length - 1}"
    return FailureError(
        Diagnostic(
            "E0405", f"there is no element {at}: {holds}", node.index.span, f"{at}", (Label(node.target.span, holds),)
        )
    )


def _maker_failure(error: MakerError, span: Span, spans: Mapping[str, Span]) -> FailureError:
    place = spans.get(error.argument, span) if error.argument else span
    return FailureError(Diagnostic(error.code, error.message, place, error.label, helps=error.helps, notes=error.notes))
