"""The kernel table against 50-digit arithmetic and against the facts that the tracer relies on."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb, ctx  # pyright: ignore[reportMissingTypeStubs]

from blobscript import kernels
from blobscript.ir import Kernel, KernelPiece

EPS = 2.0**-52
BUILT_IN = [
    Kernel("soft2"),
    Kernel("soft3"),
    Kernel("wyvill"),
    Kernel("metaball"),
    *(Kernel("gauss", a) for a in (0.01, 1.0, 4.0, 30.0, 1e4)),
    *(Kernel("gauss_c1", a) for a in (1e-200, 1e-9, 1e-3, 0.09, 0.11, 1.0, 4.0, 13.8, 30.0, 200.0, 1e4)),
]
COMPACT = [k for k in BUILT_IN if k.name != "gauss"]
# (1 - r)^2 (1 + 2 r), a smoothstep in r, as two pieces in different variables would be made by a proof
USER = Kernel(
    "smooth",
    pieces=(
        KernelPiece(0.0, 0.5, "r", 0.0, 1.0, (1.0, 0.0, -3.0, 2.0), 1, True),
        KernelPiece(0.5, 1.0, "r", 0.75, 0.25, (0.15625, -0.28125, 0.09375, 0.03125), 1, True),
    ),
    lipschitz=1.5,
)


def ident(kernel: Kernel) -> str:
    return f"{kernel.name}({kernel.a:g})" if kernel.a else kernel.name


@pytest.fixture(autouse=True)
def precision():
    before, ctx.prec = ctx.prec, 3200
    yield
    ctx.prec = before


def exact_value(kernel: Kernel, s: arb) -> arb:
    """The formulas of the language's table, as written there, in ball arithmetic."""
    a = arb(kernel.a)
    match kernel.name:
        case "soft2":
            return (1 - s) ** 2
        case "soft3":
            return (1 - s) ** 3
        case "wyvill":
            return 1 - arb(4) / 9 * s**3 + arb(17) / 9 * s**2 - arb(22) / 9 * s
        case "metaball":
            return 1 - 3 * s if s < arb(1) / 9 else arb(3) / 2 * (1 - s.sqrt()) ** 2
        case "gauss":
            return (-a * s).exp()
        case _:
            tail = (-a).exp()
            return ((-a * s).exp() - tail * (1 + a * (1 - s))) / (1 - tail * (1 + a))


def samples(kernel: Kernel) -> np.ndarray:
    """s from deep inside the centre to just inside the rim."""
    fine = np.logspace(-20, -1, 39)
    inside = np.concatenate([[0.0], fine, np.linspace(0.01, 0.99, 57), 1.0 - np.logspace(-15, -2, 27)])
    return inside[inside * kernel.a < 600.0]


def relative_errors(kernel: Kernel, s: np.ndarray, found: np.ndarray, exact) -> np.ndarray:
    return np.array(
        [abs(float(arb(v) / e - 1)) for v, e in zip(found.tolist(), map(exact, map(arb, s.tolist())), strict=True)]
    )


@pytest.mark.parametrize("kernel", BUILT_IN, ids=ident)
def test_values_keep_their_relative_accuracy_up_to_the_rim(kernel: Kernel):
    s = samples(kernel)
    errors = relative_errors(kernel, s, kernels.value(kernel, s), lambda x: exact_value(kernel, x))
    assert np.all(errors <= EPS * (6.0 + kernel.a * s))


@pytest.mark.parametrize("kernel", BUILT_IN, ids=ident)
def test_slopes_agree_with_a_certified_difference(kernel: Kernel):
    s = samples(kernel)[1:]
    s = s[np.abs(s - 1.0 / 9.0) > 1e-6]
    h = arb(2) ** -500

    def difference(x: arb) -> arb:
        return (exact_value(kernel, x + h) - exact_value(kernel, x - h)) / (2 * h)

    errors = relative_errors(kernel, s, kernels.slope(kernel, s), difference)
    assert np.all(errors <= EPS * (6.0 + kernel.a * s))


@pytest.mark.parametrize("kernel", [*BUILT_IN, USER], ids=ident)
def test_falls_from_one_and_vanishes_outside(kernel: Kernel):
    s = np.linspace(0.0, 1.0, 2001)
    d = kernels.value(kernel, s)
    assert d[0] == 1.0
    assert np.all(np.diff(d) <= 0.0)
    if kernel.name != "gauss":
        outside = np.array([1.0, 1.0 + EPS, 2.0, 1e300])
        assert np.all(kernels.value(kernel, outside) == 0.0)
        assert np.all(kernels.slope(kernel, outside) == 0.0)


@pytest.mark.parametrize("kernel", BUILT_IN, ids=ident)
def test_slope_rises_with_s_so_the_kernel_is_convex(kernel: Kernel):
    s = np.concatenate([np.linspace(0.0, 1.2, 4001), 1.0 - np.logspace(-16, -1, 100)])
    slopes = kernels.slope(kernel, np.sort(s))
    assert np.all(slopes <= 0.0)
    assert np.all(np.diff(slopes) >= -4.0 * EPS * np.abs(slopes[1:]) * (1.0 + kernel.a))


@pytest.mark.parametrize("kernel", BUILT_IN, ids=ident)
def test_inverse_is_good_to_the_last_bits(kernel: Kernel):
    """r is compared with the exact inverse by the backward error of s: D(r^2) against tau."""
    tau = np.concatenate([np.logspace(-300, -1, 60), np.linspace(0.05, 0.95, 37), 1.0 - np.logspace(-15, -2, 27)])
    tau = np.concatenate([tau, np.nextafter([2.0 / 3.0, 0.5], 0.0), [2.0 / 3.0, 0.5]])
    r = kernels.inverse(kernel, tau)
    for t, x in zip(tau.tolist(), r.tolist(), strict=True):
        lo, hi = arb(x) * (1 - 2 * arb(EPS)), arb(x) * (1 + 2 * arb(EPS))
        assert exact_value(kernel, lo**2) > arb(t), (t, x)
        assert hi >= 1 or exact_value(kernel, hi**2) < arb(t), (t, x)


@pytest.mark.parametrize("kernel", [*BUILT_IN, USER], ids=ident)
def test_inverse_outside_the_range_of_the_kernel(kernel: Kernel):
    r = kernels.inverse(kernel, np.array([1.0, 0.0, -0.1, 1.1]))
    assert r[0] == 0.0
    assert r[1] == kernels.support(kernel)
    assert np.all(np.isnan(r[2:]))


@pytest.mark.parametrize("kernel", [*BUILT_IN, USER], ids=ident)
def test_lipschitz_and_curvature_bound_what_is_found_and_are_tight(kernel: Kernel):
    top = 1.0 if kernel.name != "gauss" else 6.0 / np.sqrt(kernel.a)
    r = np.linspace(0.0, top, 40001)
    d = kernels.value(kernel, r * r)
    steepest = np.max(np.abs(np.diff(d))) / (r[1] - r[0])
    assert steepest <= kernels.lipschitz(kernel) * (1.0 + 1e-9)
    assert steepest >= kernels.lipschitz(kernel) * (1.0 - 1e-3)
    r = np.linspace(0.0, top, 1001)[:-1]
    bend = np.max(np.abs(np.diff(kernels.value(kernel, r * r), 2))) / (r[1] - r[0]) ** 2
    assert bend <= kernels.curvature(kernel) * (1.0 + 1e-6) + 1e-9
    assert bend >= kernels.curvature(kernel) * 0.5


@pytest.mark.parametrize("kernel", [*BUILT_IN, USER], ids=ident)
def test_value_range_encloses(kernel: Kernel):
    random = np.random.default_rng(1)
    ends = np.sort(random.uniform(0.0, 1.3, (500, 2)) ** 2, axis=1)
    lo, hi = kernels.value_range(kernel, ends[:, 0], ends[:, 1])
    for f in np.linspace(0.0, 1.0, 9):
        d = kernels.value(kernel, ends[:, 0] * (1 - f) + ends[:, 1] * f)
        assert np.all(lo <= d)
        assert np.all(d <= hi)
    assert np.all(hi - lo <= kernels.lipschitz(kernel) * (np.sqrt(ends[:, 1]) - np.sqrt(ends[:, 0])) + 1e-11)


def test_user_pieces_reproduce_the_polynomial():
    r = np.linspace(0.0, 1.0, 1001)[:-1]
    assert np.allclose(kernels.value(USER, r * r), (1 - r) ** 2 * (1 + 2 * r), rtol=0, atol=4 * EPS)
    assert np.allclose(kernels.slope(USER, r * r), 3 * (r - 1), rtol=0, atol=16 * EPS)


def test_a_crease_at_the_skeleton_has_an_infinite_slope_there():
    cone = Kernel("cone", pieces=(KernelPiece(0.0, 1.0, "r", 0.0, 1.0, (1.0, -1.0), 1, True),), lipschitz=1.0)
    assert kernels.slope(cone, np.array([0.0, 0.25])).tolist() == [-np.inf, -1.0]
    assert kernels.curvature(cone) == np.inf


def test_inverse_of_a_shell_is_the_outermost_radius():
    """(1 - s)(1 + 3s): rises to 4/3 at s = 1/3, then falls; D = 1 at s = 0 and at s = 2/3."""
    peak = 1.0 / np.sqrt(3.0)
    pieces = (
        KernelPiece(0.0, peak, "s", 0.0, 1.0, (1.0, 2.0, -3.0), -1, False),
        KernelPiece(peak, 1.0, "s", 0.0, 1.0, (1.0, 2.0, -3.0), -1, True),
    )
    shell = Kernel("shell", pieces=pieces, lipschitz=4.0)
    assert kernels.inverse(shell, np.array([1.0]))[0] == pytest.approx(np.sqrt(2.0 / 3.0), rel=1e-15)
    lo, hi = kernels.peak(shell)
    assert hi == pytest.approx(4.0 / 3.0, rel=1e-12)
    assert lo == pytest.approx(0.0, abs=1e-12)


def test_the_gaussian_is_cut_where_it_is_below_epsilon():
    gauss = Kernel("gauss", 4.0)
    assert kernels.value(gauss, np.array([kernels.cut(gauss, 1e-20) ** 2]))[0] <= 1e-20 * (1 + 1e-12)
    assert kernels.cut(Kernel("soft2"), 1e-20) == 1.0
