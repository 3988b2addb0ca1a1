"""Where the formatter puts a space: a table of what may touch what."""

from __future__ import annotations

from blobscript.tokens import CLOSERS, OPENERS, Token
from blobscript.words import RESERVED

__all__ = ["roles", "spaced"]

_KEYWORDS = frozenset(word.upper() for word in RESERVED) - {"TRUE", "FALSE"}
_OPERATORS = frozenset(["PLUS", "MINUS", "TIMES", "OVER", "POWER", "COMPARE", "RANGE", "AND", "OR"])

#: After one of these a value begins, so a `-` belongs to it and a `(` or `[` is no call and no index.
_BEFORE_VALUE = (_KEYWORDS | _OPERATORS | {"EQUAL", "COMMA", "COLON", "ARROW", "SPREAD", "_NL"} | set(OPENERS)) - {"FN"}

#: Never a space after or before these.
_TIGHT_AFTER = frozenset(["LPAR", "LSQB", "DOT", "POWER", "RANGE", "SPREAD", "AT"])
_TIGHT_BEFORE = frozenset(["RPAR", "RSQB", "DOT", "POWER", "RANGE", "COMMA", "COLON"])


def roles(tokens: list[Token]) -> list[str]:
    """What each token does: its kind, but "SIGN" for a `-` that belongs to a value, "HEADER" for the `)`
    of `if (…)` and `for (…)`, and "CALL" for a bracket that belongs to the name or value before it."""
    found: list[str] = []
    opened: list[str] = []
    before = "_NL"
    for token in tokens:
        role = token.kind
        begins = before in _BEFORE_VALUE or before in ("HEADER", "CALL")
        if role == "MINUS" and begins:
            role = "SIGN"
        elif role == "TIMES" and before in ("LPAR", "CALL", "COMMA"):
            role = "STAR"
        elif role in OPENERS:
            opened.append("HEADER" if before in ("IF", "FOR") else role)
            if role != "LBRACE" and not begins and before != "SIGN":
                role = "CALL"
        elif role in CLOSERS and opened and opened.pop() == "HEADER":
            role = "HEADER"
        found.append(role)
        before = role
    return found


def spaced(left: str, right: str) -> bool:
    """Whether a space stands between two neighbours of these roles on a line."""
    if left in _TIGHT_AFTER or left in ("CALL", "SIGN"):
        return False
    if right in _TIGHT_BEFORE or right == "CALL" or (right == "HEADER" and left != "_NL"):
        return False
    return not (left == "LBRACE" and right == "RBRACE")
