"""The LALR automaton: runs over tokens by the tables, builds nodes, and stops at what does not fit.

Three stacks grow together: `states` (one longer), `values` (nodes, tokens, lists of helpers) and
`places` (start and end offset of each value, and how deep it is nested). Precedence levels are a dozen
rules that pass one value on (`?sum: product`); what such a chain comes to depends only on the state
below, the symbol and the next token, so it is remembered (`_CHAINS`) and walked once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from blobscript import syntax as s
from blobscript import tables
from blobscript.diagnostics import Diagnostic, Help
from blobscript.source import Source, Span
from blobscript.tokens import END, Token

__all__ = ["MAX_NESTING", "Machine", "Make"]

#: Deeper trees are refused: later passes walk them recursively, a few Python frames for each level.
MAX_NESTING = 250

#: Where an `Error` may stand in the tree.
_MAY_FAIL = frozenset(
    """expr or_test and_test not_test comparison range sum product unary power postfix
    atom elem for_item if_item type""".split()  # noqa: SIM905
)

_CHAINS: dict[tuple[int, str, str], int] = {}

#: Builds the node of a rule from its children, between two offsets.
Make = Callable[[list[Any], int, int], Any]


class Machine:
    """A parse under way. `run` until it says "done"; after "stuck", change something and run again."""

    def __init__(self, source: Source, tokens: list[Token], start: str, make: dict[str, Make]) -> None:
        table = tables.load()
        self._source = source
        self.tokens = tokens
        self.at = 0
        self.states = [table.starts[start]]
        self.values: list[Any] = []
        self.places: list[tuple[int, int, int]] = []
        self.diagnostics: list[Diagnostic] = []
        self._table = table
        self._make = make
        self._end = table.ends[start]

    def run(self) -> bool:
        """Go on until the end (True) or a token that does not fit, `tokens[at]` (False)."""
        actions, rules = self._table.actions, self._table.rules
        states, values, places = self.states, self.values, self.places
        while True:
            token = self.tokens[self.at]
            action = actions[states[-1]].get(token.kind)
            while action is not None and action < 0:
                self._reduce(rules[~action], token.kind)
                action = actions[states[-1]].get(token.kind)
            if action is None:
                return token.kind == END and states[-1] == self._end
            states.append(action)
            values.append(token)
            places.append((token.start, token.end, 0))
            self.at += 1

    def settle(self) -> None:
        """Finish the statement that a stuck machine has just read the end of (else it would be lost with the next)."""
        actions = set(self._table.actions[self.states[-1]].values())
        if len(actions) == 1 and (action := actions.pop()) < 0:
            rule = self._table.rules[~action]
            if rule.origin.startswith("__statements"):
                self._reduce(rule, "")

    def _reduce(self, rule: tables.Rule, ahead: str) -> None:
        states, values, places = self.states, self.values, self.places
        size = rule.size
        if rule.unit:
            value = values.pop()
            place = places.pop()
            del states[-1]
        else:
            if size:
                parts, children = places[-size:], values[-size:]
                depth = 0
                for part in parts:
                    if part[2] > depth:
                        depth = part[2]
                place = (parts[0][0], parts[-1][1], depth + 1 if rule.origin in _MAY_FAIL else depth)
                del states[-size:], values[-size:], places[-size:]
            else:
                edge = places[-1][1] if places else 0
                place, children = (edge, edge, 0), []
            value = self._value(rule, children, place)
            if place[2] > MAX_NESTING:
                value = self._too_deep(place)
                place = (place[0], place[1], 0)
        states.append(self._after(states[-1], rule.origin, ahead))
        values.append(value)
        places.append(place)

    def _too_deep(self, place: tuple[int, int, int]) -> s.Error:
        """Reported once; what is nested deeper is an error of the tree."""
        source = self._source
        if not self.diagnostics:
            self.diagnostics.append(
                Diagnostic(
                    "E0901",
                    f"this is nested more than {MAX_NESTING} levels deep",
                    Span(source, place[0], min(place[1], place[0] + 1)),
                    "too deep from here on",
                    helps=(Help("give parts of it names with `let`, and add up long lists with `sum { }`"),),
                )
            )
        return s.Error(Span(source, place[0], place[1]))

    def _value(self, rule: tables.Rule, children: list[Any], place: tuple[int, int, int]) -> Any:
        picked = children if rule.whole else _picked(rule.picks, children)
        return self._make[rule.action](picked, place[0], place[1]) if rule.action else picked

    def _after(self, below: int, origin: str, ahead: str) -> int:
        """The state on top of `below` once an `origin` and all rules that only pass it on are done."""
        key = (below, origin, ahead)
        state = _CHAINS.get(key)
        if state is None:
            actions, gotos, rules = self._table.actions, self._table.gotos, self._table.rules
            state = gotos[below][origin]
            action = actions[state].get(ahead)
            while action is not None and action < 0 and rules[~action].unit:
                state = gotos[below][rules[~action].origin]
                action = actions[state].get(ahead)
            _CHAINS[key] = state
        return state

    # ---- questions and changes, for recovery ----------------------------------------------

    def accepts(self, *kinds: str) -> bool:
        """Whether tokens of these kinds could come next, one after the other."""
        table = self._table
        states = list(self.states)
        for kind in kinds:
            action = table.actions[states[-1]].get(kind)
            while action is not None and action < 0:
                rule = table.rules[~action]
                del states[len(states) - rule.size :]
                states.append(table.gotos[states[-1]][rule.origin])
                action = table.actions[states[-1]].get(kind)
            if action is None:
                return False
            states.append(action)
        return True

    def goes_to(self, level: int, symbol: str) -> bool:
        """Whether a `symbol` may stand on the stack above its first `level` values."""
        return symbol in self._table.gotos[self.states[level]]

    def cut(self, level: int) -> None:
        """Forget all but the first `level` values."""
        del self.states[level + 1 :], self.values[level:], self.places[level:]

    def push(self, symbol: str, value: Any, start: int, end: int) -> None:
        """Put a value on the stack as if it had been read."""
        self.states.append(self._table.gotos[self.states[-1]][symbol])
        self.values.append(value)
        self.places.append((start, end, 0))


def _picked(picks: tuple[tables.Pick, ...], children: list[Any]) -> list[Any]:
    picked: list[Any] = []
    for index, splice in picks:
        if index < 0:
            picked.append(None)
        elif not splice:
            picked.append(children[index])
        elif picked:
            picked += children[index]
        else:
            picked = children[index]
    return picked
