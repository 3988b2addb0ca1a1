"""A Pygments lexer for blobscript, complete in this file.

    pygmentize -x -l grammar/blobscript_pygments.py:BlobscriptLexer scene.blob

In Sphinx: `app.add_lexer("blobscript", BlobscriptLexer)`.
"""
# ruff: noqa: SIM905 - long lists of words read better as texts

from __future__ import annotations

from typing import ClassVar

from pygments.lexer import RegexLexer, bygroups, include, words
from pygments.token import Comment, Keyword, Name, Number, Operator, Punctuation, String, Whitespace

__all__ = ["BlobscriptLexer"]

# --- words, written by generate.py ---
DECLARATIONS = """
    import from as type param in step fn return let
""".split()
STATEMENTS = """
    for if else assert debug
""".split()
OPERATORS = """
    and or not
""".split()
CONSTANTS = """
    true false
""".split()
UNITS = """
    deg rad turn
""".split()
TYPES = """
    angle animate background bool camera color field image int kernel light material number skeleton stage
    surface text transform vec3
""".split()
FUNCTIONS = """
    abs acos animate apply asin atan atan2 background ball balls blob bounds camera ceil chrome clamp clay cos
    cross dot environment exp field_at filter find floor fog fold gauss gauss_c1 glass hsl image inside jelly
    lamp len length lerp line log map material max mesh metal min mirror mod move noise normalize oklch paint
    plastic point points polygon polyhedron polyline rand read_points read_records rgb rotate round scale sign
    sin sky smooth_max sqrt stone sum sun surface tan tone
""".split()
VALUES = """
    aliceblue antiquewhite aqua aquamarine azure beige bisque black blanchedalmond blue blueviolet brown
    burlywood cadetblue chartreuse chocolate coral cornflowerblue cornsilk crimson cyan darkblue darkcyan
    darkgoldenrod darkgray darkgreen darkgrey darkkhaki darkmagenta darkolivegreen darkorange darkorchid
    darkred darksalmon darkseagreen darkslateblue darkslategray darkslategrey darkturquoise darkviolet deeppink
    deepskyblue dimgray dimgrey dodgerblue firebrick floralwhite forestgreen fuchsia gainsboro ghostwhite gold
    goldenrod gray green greenyellow grey honeydew hotpink identity indianred indigo ivory khaki lavender
    lavenderblush lawngreen lemonchiffon lightblue lightcoral lightcyan lightgoldenrodyellow lightgray
    lightgreen lightgrey lightpink lightsalmon lightseagreen lightskyblue lightslategray lightslategrey
    lightsteelblue lightyellow lime limegreen linen magenta maroon mediumaquamarine mediumblue mediumorchid
    mediumpurple mediumseagreen mediumslateblue mediumspringgreen mediumturquoise mediumvioletred metaball
    midnightblue mintcream mistyrose moccasin navajowhite navy oldlace olive olivedrab orange orangered orchid
    palegoldenrod palegreen paleturquoise palevioletred papayawhip peachpuff peru phase pi pink plum powderblue
    purple rebeccapurple red rosybrown royalblue saddlebrown salmon sandybrown seagreen seashell sienna silver
    skyblue slateblue slategray slategrey snow soft2 soft3 springgreen steelblue teal thistle time tomato
    turquoise violet wheat white whitesmoke wyvill yellow yellowgreen
""".split()
# --- end of words ---

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_NUMBER = r"[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?"
_REST = r"\b"


class BlobscriptLexer(RegexLexer):
    """Reserved words are names behind a dot, and labels inside ( ) before `=` or `:`."""

    name = "blobscript"
    aliases: ClassVar[list[str]] = ["blobscript", "blob"]
    filenames: ClassVar[list[str]] = ["*.blob"]

    tokens: ClassVar[dict[str, list[object]]] = {
        "root": [include("expression")],
        "expression": [
            (r"\s+", Whitespace),
            (r"///[^\n]*", Comment.Special),
            (r"//[^\n]*", Comment.Single),
            (r'"', String.Double, "text"),
            (r"(blobscript)(\s+)([0-9]+)$", bygroups(Keyword.Namespace, Whitespace, Number.Integer)),
            (rf"(fn|kernel)(\s+)({_NAME})", bygroups(Keyword.Declaration, Whitespace, Name.Function)),
            (rf"(type)(\s+)({_NAME})", bygroups(Keyword.Declaration, Whitespace, Name.Class)),
            (rf"(let|param)(\s+)({_NAME})", bygroups(Keyword.Declaration, Whitespace, Name.Variable)),
            (rf"(@)(\s*)({_NAME})", bygroups(Name.Decorator, Whitespace, Name.Decorator)),
            (rf"({_NUMBER})({'|'.join(UNITS)})\b", bygroups(Number, Keyword.Type)),
            (rf"{_NUMBER}(?![A-Za-z0-9_])", Number),
            (r"#(?:[0-9a-fA-F]{8}|[0-9a-fA-F]{6}|[0-9a-fA-F]{3})\b", Number.Hex),
            (r"->|\.\.\.|\.\.<?|==|!=|<=|>=|[-+*/^<>=]", Operator),
            (rf"(\.)(\s*)({_NAME})", bygroups(Punctuation, Whitespace, Name.Property)),
            (r"[(\[]", Punctuation, "inside"),
            (r"\{", Punctuation, "block"),
            (r"[)\]},:.]", Punctuation),
            include("word"),
        ],
        "word": [
            (words(DECLARATIONS, suffix=_REST), Keyword.Declaration),
            (words(STATEMENTS, suffix=_REST), Keyword),
            (words(OPERATORS, suffix=_REST), Operator.Word),
            (words(CONSTANTS, suffix=_REST), Keyword.Constant),
            (words(FUNCTIONS, suffix=_REST), Name.Builtin),
            (words(TYPES, suffix=_REST), Keyword.Type),
            (words(VALUES, suffix=_REST), Name.Constant),
            (_NAME, Name),
        ],
        "inside": [
            (r"[)\]]", Punctuation, "#pop"),
            (rf"{_NAME}(?=\s*(?:=(?!=)|:))", Name.Attribute),
            include("expression"),
        ],
        "block": [(r"\}", Punctuation, "#pop"), include("expression")],
        "text": [
            (r'"', String.Double, "#pop"),
            (r"\n", Whitespace, "#pop"),
            (r"\\.", String.Escape),
            (r"\{", String.Interpol, "interpolation"),
            (r'[^"\\{\n]+', String.Double),
        ],
        "interpolation": [
            (r"\}", String.Interpol, "#pop"),
            (r'(?=["\n])', String.Interpol, "#pop"),
            include("expression"),
        ],
    }
