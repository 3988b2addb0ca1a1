"""User kernels: what is proved, what is refused and how it is said, and the pieces that come out."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from user_kernels import GOOD, prove, proved

from blobscript import kernels
from blobscript.ir import Kernel
from blobscript.report import render


def refused(text: str, **arguments):
    kernel, found = prove(text, **arguments)
    assert kernel is None
    return found


@pytest.mark.parametrize(
    ("text", "arguments", "same"), GOOD, ids=lambda x: x.split("=")[0] if isinstance(x, str) else ""
)
def test_pieces_reproduce_the_formula(text: str, arguments: dict, same):
    kernel = proved(text, **arguments)
    r = np.concatenate([np.linspace(0, 1, 1999)[:-1], 1 - np.logspace(-12, -2, 30), np.logspace(-12, -2, 30)])
    expected = np.array([same(x) for x in r.tolist()])
    assert np.allclose(kernels.value(kernel, r * r), expected, rtol=0, atol=2e-15)
    assert kernel.error < 3e-16
    assert len(kernel.pieces) <= 64
    assert max(len(piece.coefficients) for piece in kernel.pieces) <= 24


@pytest.mark.parametrize(
    ("text", "arguments", "same"), GOOD, ids=lambda x: x.split("=")[0] if isinstance(x, str) else ""
)
def test_pieces_are_what_they_claim(text: str, arguments: dict, same):
    """Joined without gaps, monotone and convex or concave in s as flagged, no steeper than proved."""
    kernel = proved(text, **arguments)
    assert kernel.pieces[0].r_lo == 0.0
    assert kernel.pieces[-1].r_hi == 1.0
    for left, right in zip(kernel.pieces, kernel.pieces[1:], strict=False):
        assert left.r_hi == right.r_lo
    steepest = 0.0
    for piece in kernel.pieces:
        s = np.linspace(piece.r_lo**2, piece.r_hi**2, 400)[1:-1]
        d = np.array([same(x) for x in np.sqrt(s).tolist()])
        first, second = np.diff(d), np.diff(d, 2)
        assert np.all(first <= 1e-14) if piece.falling else np.all(first >= -1e-14)
        match piece.convex:
            case 1:
                assert np.all(second >= -2e-14)
            case -1:
                assert np.all(second <= 2e-14)
            case _:
                assert np.all(np.abs(second) <= 2e-14)
        r = np.linspace(piece.r_lo, piece.r_hi, 400)
        steepest = max(steepest, np.max(np.abs(np.diff([same(x) for x in r.tolist()])) / (r[1] - r[0])))
    assert steepest <= kernel.lipschitz * (1 + 1e-9)
    assert steepest >= kernel.lipschitz * 0.99


@pytest.mark.parametrize(
    ("text", "arguments", "same"), GOOD, ids=lambda x: x.split("=")[0] if isinstance(x, str) else ""
)
def test_slopes_of_pieces_are_those_of_the_formula(text: str, arguments: dict, same):
    kernel = proved(text, **arguments)
    joints = np.array([piece.r_lo for piece in kernel.pieces])
    r = np.linspace(0.003, 0.997, 800)
    r = r[np.min(np.abs(r[:, None] - joints[None]), axis=1) > 2e-5]
    h = 1e-5
    slope = np.array([(same(x + h) - same(x - h)) / (2 * h) for x in r.tolist()])
    assert np.allclose(kernels.slope(kernel, r * r) * 2 * r, slope, rtol=0, atol=1e-6)


def test_kernels_that_are_built_in_come_out_as_such():
    """The table's rows, written by a user, have the table's values."""
    s = np.linspace(0, 1, 500)[:-1]
    for text, name in (
        ("kernel a(r) = (1 - r^2)^2", "soft2"),
        ("kernel a(r) = (1 - r^2)^3", "soft3"),
        ("kernel a(r) = 1 - 4/9 * r^6 + 17/9 * r^4 - 22/9 * r^2", "wyvill"),
        ("kernel a(r) = if (r < 1/3) 1 - 3 * r^2 else 3/2 * (1 - r)^2", "metaball"),
    ):
        kernel = proved(text)
        assert np.allclose(kernels.value(kernel, s), kernels.value(Kernel(name), s), rtol=0, atol=5e-16)
        assert kernel.lipschitz == pytest.approx(kernels.lipschitz(Kernel(name)), rel=2e-4)
        assert all(piece.convex >= 0 and piece.falling for piece in kernel.pieces)


def test_even_polynomials_keep_their_relative_accuracy_at_the_rim():
    kernel = proved("kernel soft(r, k: int = 3) = (1 - r^2)^k", k=4)
    s = 1 - np.logspace(-14, -1, 40)
    assert np.allclose(kernels.value(kernel, s), (1 - s) ** 4, rtol=1e-15, atol=0)


def test_inverse_of_a_proved_kernel():
    kernel = proved("kernel cosine(r) = (1 + cos(180deg * r)) / 2")
    tau = np.linspace(0.01, 0.99, 99)
    assert np.allclose(kernels.inverse(kernel, tau), np.arccos(2 * tau - 1) / np.pi, rtol=0, atol=1e-14)


def test_waived_kernels_may_leave_zero_to_one():
    kernel = proved("@allow(nonmonotone)\nkernel wave(r) = (1 - r^2)^2 * (1 + 12 * r^2 - 60 * r^4)")
    lo, hi = kernels.peak(kernel)
    r = np.linspace(0, 1, 4001)
    d = (1 - r**2) ** 2 * (1 + 12 * r**2 - 60 * r**4)
    assert lo == pytest.approx(d.min(), abs=1e-5)
    assert hi == pytest.approx(d.max(), abs=1e-5)
    assert lo < -0.5
    assert hi > 1.2


# ---- what is refused ------------------------------------------------------------------------------------

BAD = [
    ("kernel k(r) = (1 - r)^2 + 0.1", "E0501", "must end at 0, but D(1) = 0.1"),
    ("kernel k(r) = 0.9 * (1 - r^2)^2", "E0501", "must start at 1, but D(0) = 0.9"),
    ("kernel k(r) = 1 - r", "E0502", "is not flat at r = 0 and r = 1"),
    ("kernel k(r) = (1 - r)^2", "E0502", "is not flat at r = 0"),
    ("kernel k(r) = cos(90deg * r)", "E0502", "is not flat at r = 1"),
    ("kernel k(r) = (1 - r^2)^2 * (1 + 6 * r^2)", "E0503", "rises"),
    ("kernel k(r) = (1 - r^2)^2 * (1 + 2.0001 * r^2)", "E0503", "rises"),
    ("kernel k(r) = (1 + cos(540deg * r)) / 2", "E0503", "rises"),
    ("kernel k(r) = if (r < 0.5) 1 - r^2 else (1 - r)^2", "E0504", "jumps at r = 1/2"),
    ("kernel k(r) = 1 - floor(2 * r) / 2 - r^2 / 2 + (1 - r^2)^2 / 1e9", "E0501", "must start at 1"),
    ("kernel k(r) = if (r < 1/2) 1 - 2 * r^2 else (2 * (1 - r)^2 + (1 - r)) / 2", "E0505", "has a kink at r = 1/2"),
    ("kernel k(r) = 1 / (r - 0.5)", "E0506", "divides by 0 at r = 1/2"),
    ("kernel k(r) = (1 - r^2)^2 / (r - 0.5)^2 / 4", "E0506", "divides by 0"),
    ("kernel k(r) = sqrt(1 - r)", "E0506", "has no bound"),
    ("kernel k(r) = sqrt(1 - r^2)", "E0506", "has no bound"),
    ("kernel k(r) = len([r])", "E0506", "`len` cannot be followed"),
    ("kernel k(r) = 1 - r^2 + log(r)", "E0506", "logarithm"),
]


@pytest.mark.parametrize(("text", "code", "part"), BAD)
def test_what_is_no_kernel_is_refused(text: str, code: str, part: str):
    found = refused(text)
    assert code in [d.code for d in found], [d.message for d in found]
    diagnostic = next(d for d in found if d.code == code)
    assert part in diagnostic.message
    assert diagnostic.span is not None
    assert diagnostic.helps


def test_the_boundary_is_exact():
    """(1 - s)^2 (1 + 2 s) is just flat enough at the centre; a billionth more rises."""
    proved("kernel k(r) = (1 - r^2)^2 * (1 + 2 * r^2)")
    proved("kernel k(r) = (1 - r^2)^2 * (1 + 1.999999999 * r^2)")
    assert refused("kernel k(r) = (1 - r^2)^2 * (1 + 2.000000001 * r^2)")[0].code == "E0503"
    proved("kernel k(r) = if (r < 1 / 3) 1 - 3 * r^2 else 1.5 * (1 - r)^2")
    assert refused("kernel k(r) = if (r < 0.3333333333) 1 - 3 * r^2 else 1.5 * (1 - r)^2")[0].code == "E0504"


def test_a_plateau_inside_is_no_rise_and_a_touch_is_none():
    """D' = -60 r (r - 1/2)^2 (r - 1)^2 ... touches 0 at 1/2 without changing its sign."""
    slope = [Fraction(0), Fraction(-1, 4), Fraction(5, 4), Fraction(-2), Fraction(1)]  # -r (r-1/2)^2 (1-r)
    total = sum(c / (k + 1) for k, c in enumerate(slope))
    terms = " + ".join(f"({c / (k + 1) / -total}) * r^{k + 1}" for k, c in enumerate(slope) if c)
    proved(f"kernel touch(r) = 1 + {terms}")


def test_waivers_waive_and_needless_ones_are_named():
    proved("@allow(crease)\nkernel k(r) = 1 - r")
    proved("@allow(crease, nonmonotone)\nkernel k(r) = 1 - r + r * (1 - r) * 3")
    kernel, found = prove("@allow(crease)\nkernel k(r) = (1 - r^2)^2")
    assert kernel is not None
    assert [d.code for d in found] == ["W0501"]
    assert "@allow(crease)" in found[0].message
    kernel, found = prove("@allow(nonmonotone)\nkernel k(r, a = 1) = (1 - r^2)^2 * (1 + a * r^2)", a=1)
    assert kernel is not None
    assert found == []


def test_unproved_kernels_are_followed_by_samples():
    text = "kernel k(r) = 1 - r + sin(720deg * r) / (4 * pi)"  # a saddle at r = 1/2: falls, but never for certain
    assert [d.code for d in refused(text)] == ["E0506"]
    kernel, found = prove(f"@allow(unproved)\n{text}")
    assert found == []
    r = np.linspace(0, 1, 3001)
    expected = 1 - r + np.sin(4 * np.pi * r) / (4 * np.pi)
    assert np.allclose(kernels.value(kernel, r * r), expected, rtol=0, atol=1e-12)
    kernel, found = prove("@allow(unproved)\nkernel k(r) = if (r < 1) exp(1 - 1 / (1 - r^2)) else 0")
    assert found == []
    assert kernels.value(kernel, np.array([0.25]))[0] == pytest.approx(math.exp(1 - 1 / 0.75), abs=1e-13)
    jumping = refused("@allow(unproved)\nkernel k(r) = if (sqrt(r) < 0.6) 1 - r^2 else (1 - r)^1.5")
    assert [d.code for d in jumping] == ["E0506"]
    assert "jumps near r = 0.36" in jumping[0].message
    assert refused("@allow(unproved)\nkernel k(r) = 1 - sqrt(r - 1)")[0].code == "E0506"


# ---- how it is said ----------------------------------------------------------------------------------------


def test_wrong_ends_show_the_values_and_a_curve():
    (found,) = refused("kernel soft(r) = (1 - r)^2 + 0.1")
    assert (
        render(found)
        == """\
error[E0501]: kernel `soft` must end at 0, but D(1) = 0.1
 --> kernels.blob:1:18
  |
1 | kernel soft(r) = (1 - r)^2 + 0.1
  |                  ^^^^^^^^^^^^^^^ at r = 1 this is 0.1, and at r = 0 it is 1.1
  |
  = help: a kernel is 1 at the skeleton (r = 0) and 0 at the reach (r = 1).
          A jump at r = 1 would tear the surface along a sphere
  = note: D(r)  1.1 |#
                    |###
                    |######.
                0.1 |############   r = 0 .. 1
  = more: blobscript explain E0501"""
    )


def test_a_rise_is_shown_with_its_place():
    (found,) = refused("kernel shell(r) = (1 - r^2)^2 * (1 + 6 * r^2)")
    assert (
        render(found)
        == """\
error[E0503]: kernel `shell` rises: it should only fall
 --> kernels.blob:1:19
  |
1 | kernel shell(r) = (1 - r^2)^2 * (1 + 6 * r^2)
  |                   ^^^^^^^^^^^^^^^^^^^^^^^^^^^ rises from D(0) = 1 to D(0.471) = 1.412, then falls
  |
  = help: if the hollow shell is what you want, say so on the line above:
          @allow(nonmonotone)
  = note: proved exactly: D'(1/4) = 1.348 > 0
  = note: D(r)  1.41 |   .###.
                     |#########
                     |##########.
                   0 |############   r = 0 .. 1
  = more: blobscript explain E0503"""
    )


def test_a_jump_shows_both_branches():
    (found,) = refused("kernel halves(r) = if (r < 0.5) 1 - r^2 else (1 - r)^2")
    assert found.message == "kernel `halves` jumps at r = 1/2"
    assert found.span.text == "if (r < 0.5)"
    assert found.label == "the two branches meet here"
    assert [(label.span.text, label.text) for label in found.labels] == [
        ("1 - r^2", "0.75 at r = 1/2"),
        ("(1 - r)^2", "0.25 at r = 1/2"),
    ]
    assert found.helps[0].text == (
        "make both branches agree in value and slope at r = 1/2,\n"
        "for example: if (r < 0.5) 1 - 2 * r^2 else 2 * (1 - r)^2"
    )


@pytest.mark.parametrize("c", ["1/3", "0.25", "0.7"])
def test_the_example_in_the_help_is_a_kernel(c: str):
    (found,) = refused(f"kernel k(x) = if (x > {c}) (1 - x)^2 else 1 - x^2 / 9")
    example = found.helps[0].text.split("for example: ")[1]
    proved(f"kernel k(x) = {example}")


def test_tiny_rises_are_told_apart():
    found = next(d for d in refused("kernel k(r) = 1 - r + sin(360deg * r) / 6.28") if d.code == "E0503")
    assert "D(0) = 1 to D(0.00507) = 1.000002" in found.label


# ---- properties -----------------------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(-6, 6), min_size=1, max_size=4))
def test_decisions_agree_with_sampling(coefficients: list[int]):
    """(1 - r^2)^2 (1 + c1 r + c2 r^2 + ...): falls or not, wherever sampling sees it clearly."""
    polynomial = " + ".join(["1", *(f"({c}) * r^{k}" for k, c in enumerate(coefficients, 2))])
    kernel, found = prove(f"kernel k(r) = (1 - r^2)^2 * ({polynomial})")
    r = np.linspace(0, 1, 4001)
    d = (1 - r**2) ** 2 * (1 + sum(c * r**k for k, c in enumerate(coefficients, 2)))
    highest_rise = np.max(np.diff(d))
    assume(abs(highest_rise) > 1e-9)
    assert (kernel is None) == (highest_rise > 0)
    assert [d.code for d in found] == ([] if kernel is not None else ["E0503"])


@settings(max_examples=25, deadline=None)
@given(st.floats(0.2, 20), st.floats(0.5, 6))
def test_families_of_transcendental_kernels(a: float, b: float):
    """A blend of two compensated Gaussians is always a kernel."""
    kernel = proved(
        "kernel k(r, a = 1, b = 1) = ((exp(-a * r^2) - exp(-a) * (1 + a * (1 - r^2))) / (1 - (1 + a) * exp(-a))"
        " + (exp(-b * r^2) - exp(-b) * (1 + b * (1 - r^2))) / (1 - (1 + b) * exp(-b))) / 2",
        a=a,
        b=b,
    )
    s = np.linspace(0, 1, 300)[:-1]
    expected = (kernels.value(Kernel("gauss_c1", a), s) + kernels.value(Kernel("gauss_c1", b), s)) / 2
    assert np.allclose(kernels.value(kernel, s), expected, rtol=0, atol=1e-14)
    assert all(piece.convex == 1 and piece.falling for piece in kernel.pieces)


@pytest.mark.parametrize(
    ("code", "body"),
    [
        ("E0501", "1 - r^2 / 2"),
        ("E0502", "1 - r"),
        ("E0503", "(1 - r^2)^2 * (1 + 6 * r^2)"),
        ("E0504", "if (r < 0.5) 1 - r^2 else 0"),
        ("E0505", "if (r < 0.5) 1 - 2 * r^2 else (1 - r)^2 * 2 + (r - 0.5) * (1 - r)^2"),
    ],
)
def test_what_is_wrong_is_drawn(code: str, body: str):
    (found,) = [d for d in refused(f"kernel own(r) = {body}") if d.code == code]
    (drawn,) = [note for note in found.notes if note.startswith("D(r)")]
    assert drawn.count("|") == 4
    assert drawn.endswith("r = 0 .. 1")
