"""Numbers as people read them in reports."""

from __future__ import annotations

import math

__all__ = ["count", "factor", "joined", "length", "micro", "percent", "plural", "seconds"]


def count(number: float) -> str:
    """12 345, with thin spaces."""
    return f"{number:,.0f}".replace(",", "\u202f")


def plural(number: int, noun: str) -> str:
    return f"{count(number)} {noun}{'' if number == 1 else 's'}"


def length(value: float) -> str:
    """An error or tolerance."""
    if math.isnan(value):
        return "–"
    return "0" if value == 0.0 else f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")


def micro(value: float) -> str:
    """Seconds as micro- or nanoseconds with three digits."""
    return f"{1e6 * value:.3g} µs" if value >= 0.9995e-6 else f"{1e9 * value:.3g} ns"


def seconds(value: float) -> str:
    """With the unit that fits."""
    if value < 1e-3:
        return micro(value)
    return f"{1e3 * value:.3g} ms" if value < 1.0 else f"{value:.3g} s"


def percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.095 else f"{100 * share:.2g} %"


def factor(value: float) -> str:
    """`1.3 times`."""
    return f"{value:.2g} times" if value < 9.95 else f"{count(value)} times"


def joined(parts: list[str]) -> str:
    """a, b and c."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else "".join(parts)
