"""What the command line accepts, and how it refuses."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Sequence
from typing import NoReturn

from blobscript.diagnostics import BlobscriptError

__all__ = ["AOVS", "INDEXES", "NORMALS", "SEARCHES", "UsageError", "parse_arguments"]

SEARCHES = ("sandwich", "bernstein", "interval", "segment", "sphere", "march")
INDEXES = ("bvh", "grid", "octree", "bsp", "none")
NORMALS = ("analytic", "forward", "central")
AOVS = (
    *("depth", "normal", "position", "surface"),
    *("evaluations", "nodes", "candidates", "spans", "sandwiches", "fallbacks"),
    *("albedo", "direct", "indirect", "samples"),
)

#: Of the stress catalogue (`blobscript.stress.GROUPS`).
_STRESS_GROUPS = (
    "stiff",
    "cancelling",
    "grazing",
    "thin",
    "scale",
    "degenerate",
    "start",
    "joint",
    "bulge",
    "load",
    "input",
)


class UsageError(BlobscriptError):
    """Wrong usage of the command line: exit code 2."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{_in_our_words(message)}\n  = help: blobscript{_verb_of(self)} --help lists what there is")


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    """The arguments of one command; `module` names the module of this package that runs it."""
    parser, verbs = _parsers()
    _refuse_unknown_verb(argv, verbs)
    arguments, rest = parser.parse_known_args(argv)
    if rest and hasattr(arguments, "items"):  # argparse takes no more of a list of files after an option
        arguments.items += [word for word in rest if not word.startswith("-")]
        rest = [word for word in rest if word.startswith("-")]
    if rest:
        _refuse_rest(rest, verbs[arguments.verb])
    return arguments


# ---- the verbs ---------------------------------------------------------------------------


def _parsers() -> tuple[_Parser, dict[str, argparse.ArgumentParser]]:
    from blobscript import __version__

    parser = _Parser(
        prog="blobscript",
        description="Blobs from scripts: check, render, inspect.",
        epilog="blobscript VERB --help tells more. Exit codes: 0 fine, 1 the program has errors, 2 wrong usage, "
        "3 cannot read or write, 4 render failed, 130 interrupted.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"blobscript {__version__}")
    adder = parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=_Parser)

    check = _verb(adder, "check", "report every mistake of a script")
    _script(check, formats=("text", "json", "sarif"))
    check.add_argument("--fix", action="store_true", help="apply the safe fixes to the file")
    check.add_argument("--ask", action="store_true", help="with --fix: offer the guesses one by one as well")

    _render_options(_verb(adder, "render", "make a picture"))
    _animate_options(_verb(adder, "animate", "make a film"))

    to = _verb(adder, "compile", "write the scene in another form")
    _script(to)
    to.add_argument(
        "--to", choices=("json", "pov", "c"), required=True, help="json: the scene IR; pov: for POV-Ray; c: a program"
    )
    to.add_argument("-o", dest="output", metavar="OUT", help="the file to write (standard output without)")
    _grid_option(to)

    compare = _verb(adder, "compare", "render here and with POV-Ray, and report how the two differ")
    _script(compare)
    compare.add_argument("-o", dest="output", metavar="OUT", help="the report: .html .json")
    compare.add_argument("--size", type=_size, metavar="WxH", help="pixels (default: the script's `image`, or 640x480)")
    compare.add_argument(
        "--timeout", type=_positive, default=600.0, metavar="S", help="seconds for each run of POV-Ray (default 600)"
    )
    _grid_option(compare)

    pov = _verb(adder, "import-pov", "the blobs of a POV-Ray scene as a script")
    pov.set_defaults(module="import_pov")
    pov.add_argument("file", metavar="FILE.pov", help="the scene")
    pov.add_argument("-o", dest="output", metavar="OUT.blob", help="the script to write (standard output without)")
    pov.add_argument(
        "--declare", dest="declared", metavar="name=number", action="append", default=[], help="as POV-Ray's Declare"
    )
    pov.add_argument("--format", choices=("text", "json"), default="text", help="of what is printed")

    info = _verb(adder, "info", "what a scene or a finished picture contains")
    _script(info, file_help="a script, or a picture that blobscript made")
    info.add_argument("--needs", action="store_true", help="what the scene needs, line by line, and what is left out")

    _plot_options(_verb(adder, "plot", "draw kernels, a slice through the field, or the search along a ray"))
    _why_options(_verb(adder, "why", "the terms that make a pixel, each with its value and line of the script"))
    _report_options(_verb(adder, "report", "measure error against run time, and say which method to take"))
    _bench_options(_verb(adder, "bench", "measure many scenes beside the peers that are installed"))

    _mesh_options(_verb(adder, "mesh", "make triangles: for printing, for other programs, for the web"))
    _script(_verb(adder, "params", "the parameters of a script (json: a JSON schema)"))

    stress = _verb(adder, "stress", "stiff and extreme cases with certified answers")
    stress.add_argument("--only", metavar="GROUP", choices=_STRESS_GROUPS, action="append", default=[], help="a group")
    stress.add_argument("-o", dest="output", metavar="OUT", help="a page as well: .html .md .json")
    stress.add_argument("--show", metavar="CASE", help="the script of one case, and what it is about")
    stress.add_argument("--no-povray", action="store_true", help="without POV-Ray's answers, where it is installed")
    stress.add_argument("--format", choices=("text", "json"), default="text", help="of what is printed")

    explain = _verb(adder, "explain", "the page of an error code or a topic")
    explain.add_argument("code", metavar="CODE", nargs="?", help="for example E0301, or random; all there are without")

    doctor = _verb(adder, "doctor", "what is installed, and what is missing for what")
    doctor.add_argument("--format", choices=("text", "json"), default="text")

    fmt = _verb(adder, "fmt", "format scripts in place")
    fmt.add_argument("files", metavar="FILE.blob", nargs="+", help="- reads standard input and prints the result")
    fmt.add_argument("--check", action="store_true", help="change nothing; exit 1 where something would change")
    fmt.add_argument("--diff", action="store_true", help="change nothing; print what would change")
    return parser, dict(adder.choices)


def _verb(adder: argparse._SubParsersAction[_Parser], name: str, summary: str) -> argparse.ArgumentParser:  # pyright: ignore[reportPrivateUsage]
    parser = adder.add_parser(name, help=summary, description=f"{summary[0].upper()}{summary[1:]}.", allow_abbrev=False)
    parser.set_defaults(module={"compile": "compile_to", "doctor": "doctor"}.get(name, name))
    return parser


def _script(
    parser: argparse.ArgumentParser,
    *,
    formats: tuple[str, ...] = ("text", "json"),
    file_help: str = "the script",
) -> None:
    parser.add_argument("file", metavar="FILE.blob", help=file_help)
    _script_options(parser, formats)
    _moment_options(parser)


def _script_options(parser: argparse.ArgumentParser, formats: tuple[str, ...] = ("text", "json")) -> None:
    parser.add_argument("--set", dest="sets", metavar="name=value", action="append", default=[], help="a parameter")
    parser.add_argument("--params", metavar="FILE.json", help="parameters by name; --set wins over them")
    parser.add_argument("--budget", type=_count, metavar="N", help="steps the script may take (default 2 million)")
    parser.add_argument("--format", choices=formats, default="text", help="of what is printed")


def _moment_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--time", type=_number, default=0.0, metavar="T", help="`time` in the script, in seconds")
    parser.add_argument("--phase", type=_phase, default=0.0, metavar="P", help="`phase` in the script, 0 to 1")


def _grid_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--grid",
        type=_grid,
        metavar="N",
        help="samples along the longest side of a surface that is too large for POV-Ray's functions (default 200)",
    )


def _render_options(parser: argparse.ArgumentParser) -> None:
    _script(parser)
    add = parser.add_argument
    add("-o", dest="output", metavar="OUT", required=True, help="the picture: .png .exr .tif .jpg .webp")
    add("--size", type=_size, metavar="WxH", help="pixels (default: the script's `image`, or 640x480)")
    _light_options(parser)
    add("--timing", action="store_true", help="tell what the time went into")
    add("--threads", type=_count, metavar="N", help="default: all cores; the picture does not depend on it")
    add("--seed", type=_whole, default=0, metavar="N", help="of the sample pattern")
    add("--bits", type=int, choices=(8, 16, 32), help="per channel (default 8; 32 in EXR)")
    add("--index", choices=INDEXES, default="bvh", help="the spatial index")
    add("--search", choices=SEARCHES, default="sandwich", help="the search along the ray; the first three miss nothing")
    add("--tolerance", type=_positive, metavar="D", help="default: a few ulp; segment, sphere: 1e-9 mean reaches")
    add("--step", type=_positive, metavar="D", help="of march; default: 1/20 of the mean reach")
    add("--normals", choices=NORMALS, default="analytic")
    add("--normal-step", type=_positive, metavar="D", help="default: 1e-8 (central: 1e-6) mean reaches")
    add("--native", nargs="?", const="always", choices=("always", "auto"), help="a tracer compiled for this scene")
    add("--region", type=_region, metavar="X0,Y0,X1,Y1", help="only these pixels, the last ones excluded")
    add("--aov", type=_aovs, default=(), metavar="NAME,…", help="more layers: " + ", ".join(AOVS))


def _animate_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("file", metavar="FILE.blob", help="the script; it has `animate(seconds, fps)`")
    _script_options(parser)
    add("-o", dest="output", metavar="OUT", required=True, help="the film: .gif .png (APNG) .mp4 .webm")
    add("--size", type=_size, metavar="WxH", help="pixels (default: the script's `image`, or 640x480)")
    add("--frames", type=_frames, metavar="A..B", help="only these, the first is 0, the last is in")
    add("--shard", type=_shard, metavar="K/N", help="only every Nth frame from the Kth on, not joined: for N machines")
    _light_options(parser)
    add("--blur", type=_count, default=1, metavar="N", help="motion blur: N moments per frame")
    add("--shutter", type=_share, metavar="S", help="part of a frame's time that --blur sees (default 0.5)")
    add("--seed", type=_whole, default=0, metavar="N", help="of the sample pattern")
    add("--threads", type=_count, metavar="N", help="default: all cores; the film does not depend on it")
    add("--keep", action="store_true", help="keep the folder of the frames when the film is there")


def _plot_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("what", choices=("kernel", "slice", "ray"), help="D and D' over r; a plane; one ray with its spans and bounds")
    add(
        "items", metavar="FILE.blob", nargs="*", help="the script; for `kernel` also names such as soft3 'gauss(a = 4)'"
    )
    _script_options(parser)
    _moment_options(parser)
    add("-o", dest="output", metavar="OUT", required=True, help="the figure: .svg or .png")
    add(
        "--threshold", type=_number, metavar="T", help="kernel: where radii are marked (default: the scene's, else 0.5)"
    )
    add("--weight", type=_number, metavar="W", help="kernel: factor of the densities (default 1)")
    add("--plane", type=_plane, metavar="z=0", help="slice: which one (default: through the middle, facing the camera)")
    add("--surface", metavar="NAME", help="slice, ray: name or number of one surface")
    add("--pixel", type=_pixel, metavar="X,Y", help="ray: the one of a pixel (default: the hit next to the middle)")
    add("--size", type=_size, metavar="WxH", help="ray: size of the picture that --pixel means")
    add("--from", dest="origin", type=_triple, metavar="X,Y,Z", help="ray: where it starts, with --toward")
    add("--toward", dest="direction", type=_triple, metavar="X,Y,Z", help="ray: the way it goes")


def _report_options(parser: argparse.ArgumentParser) -> None:
    _script(parser)
    add = parser.add_argument
    add("-o", dest="output", metavar="OUT", required=True, help="the report: .html, .json or .md")
    add("--quick", action="store_true", help="fewer tolerances, meshes and samples")
    add("--seed", type=_whole, default=0, metavar="N", help="of the rays")
    add("--threads", type=_count, metavar="N", help="processes that certify (default: all cores); timing is on one")


def _mesh_options(parser: argparse.ArgumentParser) -> None:
    _script(parser)
    add = parser.add_argument
    add("-o", dest="output", metavar="OUT", required=True, help="the mesh: .stl .ply .obj .glb .3mf")
    fine = parser.add_mutually_exclusive_group()
    fine.add_argument("--cell", type=_positive, metavar="SIZE", help="size of cells, in units of the script")
    fine.add_argument("--resolution", type=_count, metavar="N", help="cells along the longest side (default 128)")
    fine.add_argument("--tolerance", type=_positive, metavar="D", help="largest distance between mesh and surface")
    add("--adaptive", action="store_true", help="with --tolerance: large cells where they do")
    add(
        "--relax",
        type=_count,
        nargs="?",
        const=5,
        default=0,
        metavar="N",
        help="make triangles more even, N rounds (5)",
    )
    add("--clip", type=_box, metavar="X0,Y0,Z0,X1,Y1,Z1", help="cut solids to this box, and cap them there")
    add("--refine", type=_whole, default=2, metavar="N", help="halve cells that may hide something up to N times (2)")
    add("--unit", choices=("mm", "cm", "m", "in"), help="what a unit of the script is")
    add("--threads", type=_count, metavar="N", help="default: all cores; the mesh does not depend on it")
    add("--report", metavar="REPORT", help="how good the mesh is: .html .md .json")


def _bench_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("items", metavar="FILE.blob", nargs="*", help="the scripts (default: the examples)")
    add("-o", dest="output", metavar="OUT", help=".html, .json or .md (default: Markdown on standard output)")
    add("--quick", action="store_true", help="fewer rays")
    add("--seed", type=_whole, default=0, metavar="N", help="of the rays")
    add("--threads", type=_count, metavar="N", help="processes that certify (default: all cores); timing is on one")


def _why_options(parser: argparse.ArgumentParser) -> None:
    _script(parser)
    parser.add_argument("pixel", type=_pixel, metavar="X,Y", help="the pixel; 0,0 is the top left one")
    parser.add_argument("--size", type=_size, metavar="WxH", help="of the picture (default: the script's)")
    parser.add_argument("-o", dest="output", metavar="OUT", help="a figure as well: .svg or .png")


def _light_options(parser: argparse.ArgumentParser) -> None:
    """How much light is looked for, and how it becomes a picture."""
    add = parser.add_argument
    add("--samples", type=_samples, metavar="N", help="samples per pixel; with --noise at most so many (256)")
    add("--noise", type=_share, metavar="E", help="samples until a pixel's error is below E, white is 1 (default 0.01)")
    add("--indirect", choices=("even", "occlusion", "bounce"), help="light from all sides (default: one bounce)")
    add("--transparent", action="store_true", help="no background: alpha tells what hides it, or shades the floor")
    add("--exposure", type=_number, metavar="STOPS", help="1 doubles the light (default: the script's)")
    add("--tone", choices=("linear", "film"), help="the curve from light to picture (default: the script's)")


# ---- values of options ---------------------------------------------------------------------


def _count(text: str) -> int:
    return _integer(text, 1)


def _whole(text: str) -> int:
    return _integer(text, 0)


def _integer(text: str, least: int) -> int:
    digits = text.isascii() and text.isdigit()
    if digits and len(text) > 18:
        raise argparse.ArgumentTypeError(f"`{text}` is too large")
    if not digits or int(text) < least:
        raise argparse.ArgumentTypeError(f"`{text}` is not a whole number from {least} up")
    return int(text)


def _samples(text: str) -> int:
    value = _count(text)
    if value > 65536:
        raise argparse.ArgumentTypeError(f"`{text}` is too large: 65536 at most")
    return value


def _grid(text: str) -> int:
    value = _count(text)
    if not 16 <= value <= 1000:
        raise argparse.ArgumentTypeError(f"wants a whole number from 16 to 1000, not {value}")
    return value


def _positive(text: str) -> float:
    value = _finite(text)
    if value is None or value <= 0.0:
        raise argparse.ArgumentTypeError(f"`{text}` is not a positive number")
    return value


def _number(text: str) -> float:
    value = _finite(text)
    if value is None:
        raise argparse.ArgumentTypeError(f"`{text}` is not a number")
    return value


def _phase(text: str) -> float:
    value = _number(text)
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"`{text}` does not lie in 0 to 1")
    return value


def _finite(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _size(text: str) -> tuple[int, int]:
    parts = text.lower().split("x")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"`{text}` is not a size such as 640x480")
    width, height = (_count(part) for part in parts)
    if width * height > 1 << 28 or max(width, height) > 65535:
        raise argparse.ArgumentTypeError(f"`{text}` is larger than a picture can be (65535 a side, 268 million pixels)")
    return width, height


def _box(text: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    parts = text.split(",")
    if len(parts) != 6:
        raise argparse.ArgumentTypeError(f"`{text}` is not six numbers such as -1,-1,-1,1,1,1")
    numbers = tuple(_number(part) for part in parts)
    if any(lo >= hi for lo, hi in zip(numbers[:3], numbers[3:], strict=True)):
        raise argparse.ArgumentTypeError(f"`{text}` is no box: X0 < X1, Y0 < Y1 and Z0 < Z1")
    return numbers[:3], numbers[3:]


def _region(text: str) -> tuple[int, int, int, int]:
    parts = text.split(",")
    if len(parts) != 4:
        raise argparse.ArgumentTypeError(f"`{text}` is not four pixel numbers such as 0,0,320,240")
    x0, y0, x1, y1 = (_whole(part) for part in parts)
    if x0 >= x1 or y0 >= y1:
        raise argparse.ArgumentTypeError(f"`{text}` has no pixel: X0 < X1 and Y0 < Y1")
    return x0, y0, x1, y1


def _pixel(text: str) -> tuple[int, int]:
    parts = text.split(",")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"`{text}` is not a pixel such as 320,240")
    x, y = (_whole(part.strip()) for part in parts)
    return x, y


def _triple(text: str) -> tuple[float, float, float]:
    parts = text.strip("() ").split(",")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"`{text}` is not three numbers such as 0,1.5,-2")
    x, y, z = (_number(part.strip()) for part in parts)
    return x, y, z


def _frames(text: str) -> tuple[int, int]:
    """First and last frame."""
    first, dots, last = text.partition("..")
    if not dots:
        raise argparse.ArgumentTypeError(f"`{text}` is not a range of frames such as 0..47")
    a, b = _whole(first.strip()), _whole(last.strip())
    if a > b:
        raise argparse.ArgumentTypeError(f"`{text}` holds no frame: the first comes after the last")
    return a, b


def _shard(text: str) -> tuple[int, int]:
    """Which part, from 1 up, of how many."""
    part, slash, parts = text.partition("/")
    if not slash:
        raise argparse.ArgumentTypeError(f"`{text}` is not a part such as 1/4")
    k, n = _count(part.strip()), _count(parts.strip())
    if k > n:
        raise argparse.ArgumentTypeError(f"`{text}`: there is no part {k} of {n}")
    return k, n


def _share(text: str) -> float:
    value = _finite(text)
    if value is None or not 0.0 < value <= 1.0:
        raise argparse.ArgumentTypeError(f"`{text}` does not lie between 0 and 1")
    return value


def _plane(text: str) -> tuple[int, float]:
    """Axis 0, 1, 2 and the coordinate."""
    axis, equals, value = text.replace(" ", "").partition("=")
    if axis not in ("x", "y", "z") or not equals:
        raise argparse.ArgumentTypeError(f"`{text}` is not a plane such as z=0 or y=0.5")
    return "xyz".index(axis), _number(value)


def _aovs(text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    for name in names:
        if name not in AOVS:
            raise argparse.ArgumentTypeError(f"there is no layer `{name}`{_did_you_mean(name, AOVS)}")
    return names


# ---- refusals ------------------------------------------------------------------------------


def _refuse_unknown_verb(argv: Sequence[str], verbs: Iterable[str]) -> None:
    if not argv:
        raise UsageError(
            "blobscript wants a verb: " + ", ".join(verbs) + "\n  = help: blobscript render hello.blob -o hello.png"
        )
    word = argv[0]
    if word.startswith("-") or word in verbs:
        return
    if word.endswith(".blob"):
        raise UsageError(f"a verb stands before the script: blobscript render {word} -o out.png")
    raise UsageError(
        f"there is no verb `{word}`{_did_you_mean(word, verbs)}\n  = help: blobscript --help lists all verbs"
    )


def _refuse_rest(rest: Sequence[str], parser: argparse.ArgumentParser) -> NoReturn:
    word = rest[0].split("=")[0]
    if word.startswith("-"):
        known = [name for name in parser._option_string_actions if name.startswith("--")]
        reason = f"there is no option `{word}`{_did_you_mean(word, known)}"
    else:
        reason = f"one `{word}` too many"
    raise UsageError(f"{reason}\n  = help: blobscript{_verb_of(parser)} --help lists what there is")


def _did_you_mean(word: str, known: Iterable[str]) -> str:
    from difflib import get_close_matches

    close = get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean `{close[0]}`?" if close else ""


def _verb_of(parser: argparse.ArgumentParser) -> str:
    return parser.prog.removeprefix("blobscript")


def _in_our_words(message: str) -> str:
    """argparse's sentence as one of ours."""
    import re

    if found := re.match(r"the following arguments are required: (.*)", message):
        return f"missing: {found[1]}"
    if found := re.match(r"argument ([^:]*): invalid choice: '?(.*?)'? \(choose from (.*)\)", message):
        choices = [choice.strip().strip("'") for choice in found[3].split(",")]
        return f"{found[1]} cannot be `{found[2]}`{_did_you_mean(found[2], choices)}; it is one of {', '.join(choices)}"
    if found := re.match(r"argument ([^:]*): (.*)", message):
        return f"{found[1].split('/')[-1]}: {found[2]}"
    return message
