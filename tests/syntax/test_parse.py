"""What parses, into what tree, and where its nodes are."""

from __future__ import annotations

import re

import pytest
from syntax.scripts import named, parsed, scripts, shape, spans

from blobscript import syntax as s
from blobscript import tables
from blobscript.parse import parse
from blobscript.source import Source


@pytest.mark.parametrize("path", scripts(), ids=named)
def test_scripts_parse(path) -> None:
    script = parsed(path.read_text(encoding="utf-8"))
    assert script.items
    assert all(0 <= span.start <= span.end <= len(span.source.text) for span in spans(script))


def test_grammar_has_no_conflicts() -> None:
    """lark's strict mode refuses shift/reduce conflicts and terminals that collide."""
    from lark import Lark

    Lark(tables.grammar_text(), parser="lalr", lexer="contextual", strict=True, start=list(tables.STARTS))


def expression(text: str) -> s.Expr:
    item = parsed(f"let x = {text}").items[0]
    assert isinstance(item, s.Let)
    return item.value


def written(node: s.Expr) -> str:
    """An expression with a bracket around every operation."""
    match node:
        case s.Binary(op, left, right):
            return f"[{written(left)} {op} {written(right)}]"
        case s.Unary(op, operand):
            return f"[{op} {written(operand)}]"
        case s.Range(lo, hi, half_open):
            return f"[{written(lo)} {'..<' if half_open else '..'} {written(hi)}]"
        case s.IfExpr(condition, then, otherwise):
            return f"[if {written(condition)} then {written(then)} else {written(otherwise)}]"
        case _:
            return node.span.text


@pytest.mark.parametrize(
    ("text", "tree"),
    [
        ("1 + 2 * 3 ^ 4", "[1 + [2 * [3 ^ 4]]]"),
        ("1 - 2 - 3", "[[1 - 2] - 3]"),
        ("a / b * c", "[[a / b] * c]"),
        ("2 ^ 3 ^ 4", "[2 ^ [3 ^ 4]]"),
        ("-a ^ 2", "[- [a ^ 2]]"),
        ("2 ^ -1", "[2 ^ [- 1]]"),
        ("not a == b and c or d", "[[[not [a == b]] and c] or d]"),
        ("0 .. n - 1", "[0 .. [n - 1]]"),
        ("0..<8 == r", "[[0 ..< 8] == r]"),
        ("a + if (b) c else d + e", None),
        ("if (b) c else d + e", "[if b then c else [d + e]]"),
        ("a.b(c)[d].e", "a.b(c)[d].e"),
    ],
)
def test_operators_bind(text: str, tree: str | None) -> None:
    if tree is None:
        assert parse(Source("t.blob", f"let x = {text}"))[1]
    else:
        assert written(expression(text)) == tree


@pytest.mark.parametrize(
    ("text", "value"),
    [("3", 3), ("0.5", 0.5), ("1e-3", 0.001), ("2E3", 2000.0), ("007", 7), ("1.50", 1.5)],
)
def test_numbers(text: str, value: float) -> None:
    node = expression(text)
    assert isinstance(node, s.Number)
    assert node.value == value
    assert type(node.value) is type(value)


def test_angles_and_colours() -> None:
    angle = expression("-0.5turn")
    assert isinstance(angle, s.Unary)
    assert isinstance(angle.operand, s.Angle)
    assert (angle.operand.value, angle.operand.unit) == (0.5, "turn")
    for text, rgba in [
        ("#f80", (1, 0x88 / 255, 0, 1)),
        ("#ff8800", (1, 0x88 / 255, 0, 1)),
        ("#ff880080", (1, 0x88 / 255, 0, 0x80 / 255)),
    ]:
        color = expression(text)
        assert isinstance(color, s.Color)
        assert color.rgba == pytest.approx(rgba)


def test_texts() -> None:
    text = expression(r'"a\n\"\{b\}\\ {x + 1}{y}"')
    assert isinstance(text, s.Text)
    assert text.parts[0] == 'a\n"{b}\\ '
    assert [part.span.text for part in text.parts[1:] if not isinstance(part, str)] == ["x + 1", "y"]
    assert expression('""').parts == ()  # type: ignore[union-attr]


def test_brackets_mean_one_thing_each() -> None:
    kinds = {
        "(1)": s.Group,
        "(1, 2, 3)": s.Vector,
        "(1, 2,)": s.Vector,
        "(a = 1)": s.Record,
        "(a = 1, b = 2,)": s.Record,
        "[]": s.List,
        "[1, ...b, for (x in c) x, if (d) e, if (d) e else f]": s.List,
        "f()": s.Call,
        "f { }": s.Call,
        "a.f { b }": s.Call,
        "a[1]": s.Index,
        "fn(a, b: int = 1) -> number = a": s.Lambda,
    }
    for text, kind in kinds.items():
        assert isinstance(expression(text), kind), text


def test_block_goes_to_the_call() -> None:
    call = expression("a.f(1) {\n b\n ...c\n for (i, x in d) { }\n if (e) { } else if (g) { } else { h }\n}")
    assert isinstance(call, s.Call)
    assert isinstance(call.callee, s.Member)
    assert call.block is not None
    assert [type(item).__name__ for item in call.block.items] == ["Name", "Spread", "For", "If"]
    bare = expression("sum { a }")
    assert isinstance(bare, s.Call)
    assert bare.arguments is None


@pytest.mark.parametrize(
    ("text", "items"),
    [
        ("a\nb", 2),
        ("a\n\n// c\n\nb // d\n", 2),
        ("a\n  .b()\n  .c()", 1),
        ("a +\nb", 1),
        ("a\n+ b", 1),
        ("a\n- b", 2),
        ("a\n...b", 2),
        ("a\n..b", 1),
        ("a\n< b", 1),
        ("a\n(b)", 2),
        ("a\n[b]", 2),
        ("f(a,\nb\n)\nc", 2),
        ("[a,\n-b]\nc", 2),
        ("sum\n{\na\nb\n}\nc", 2),
        ("if (a) { b }\nelse { c }\nd", 2),
        ("let x =\n  1\nb", 2),
        ("a\nand b\nor c", 1),
        ("f(sum {\na\nb\n}, 1)\nc", 2),
        ("blobscript 1", 0),
        ("// only a comment", 0),
        ("", 0),
        ("\ufeffa\r\nb\r\n", 2),
    ],
)
def test_line_ends(text: str, items: int) -> None:
    assert len(parsed(text).items) == items


@pytest.mark.parametrize("word", sorted(tables.load().words))
def test_reserved_words_are_free_as_labels(word: str) -> None:
    parsed(f"f({word} = 1, {word} = 2)\nlet r = (a = 1, {word} = 2)\nlet m = r.{word}")
    parsed(f"type T = (a: int, {word}: number)")


def test_kernel_is_also_a_type_and_a_label() -> None:
    script = parsed("kernel k(r) = 1 - r\nfn f(k: kernel) -> kernel = k\nsum(kernel = k) { a }\nlet t = x.kernel")
    assert [type(item).__name__ for item in script.items] == ["KernelDecl", "Fn", "Call", "Let"]


def test_docs_and_attributes() -> None:
    script = parsed(
        '/// Two\n/// lines.\n@group("A")\n@hidden\nparam a = 1 in 0..2 step 1\n\n/// not mine\n\nlet b = 1\n'
        "/// Mine.\nfn c(x) = x // no doc\nlet d = 2 /// no doc\nlet e = 3\n"
    )
    a, b, c, d, e = script.items
    assert a.doc == "Two\nlines."
    assert [(attribute.name.text, len(attribute.arguments)) for attribute in a.attributes] == [
        ("group", 1),
        ("hidden", 0),
    ]
    assert (b.doc, c.doc, d.doc, e.doc) == ("", "Mine.", "", "")


def test_parameters_after_a_star_are_named_only() -> None:
    fn = parsed('fn f(a, *, b: int, c = 1,) {\n  let d = a\n  assert d, "x"\n  debug d\n  return d\n}').items[0]
    assert isinstance(fn, s.Fn)
    assert [(p.name.text, p.named_only) for p in fn.parameters] == [("a", False), ("b", True), ("c", True)]
    assert [type(statement).__name__ for statement in fn.statements] == ["Let", "Assert", "Debug"]


def test_imports() -> None:
    names, module, std = parsed('import a, b from "x.blob"\nimport "y.blob" as y\nimport c from std.curves').items
    assert isinstance(names, s.ImportNames)
    assert ([name.text for name in names.names], names.path, names.is_file) == (["a", "b"], "x.blob", True)
    assert isinstance(module, s.ImportModule)
    assert (module.path, module.alias.text) == ("y.blob", "y")
    assert isinstance(std, s.ImportNames)
    assert (std.path, std.is_file) == ("std.curves", False)


def test_types() -> None:
    alias = parsed("type T = (a: [int], f: (number, text) -> bool, g: () -> T)").items[0]
    assert shape(alias.type) == (
        "RecordType",
        (
            (("Name", "a"), ("ListType", ("NamedType", "int"))),
            (("Name", "f"), ("FnType", (("NamedType", "number"), ("NamedType", "text")), ("NamedType", "bool"))),
            (("Name", "g"), ("FnType", (), ("NamedType", "T"))),
        ),
    )


def test_spans_are_the_text_of_the_node() -> None:
    text = 'surface(a = 1) {\n  ball((0, 0), r = 2).paint(#fff)\n}\nlet t = "x {y + 1}"\n'
    script = parsed(text)
    surface, let = script.items
    assert surface.span.text == text[: text.index("}") + 1]
    assert surface.arguments[0].span.text == "a = 1"
    paint = surface.block.items[0]
    assert paint.callee.target.span.text == "ball((0, 0), r = 2)"
    assert let.value.parts[1].op_span.text == "+"
    assert re.fullmatch(r'let t = ".*"', let.span.text)
