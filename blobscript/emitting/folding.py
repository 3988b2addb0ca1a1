"""Conditions whose outcome is known, folded: the branches that cannot be taken are gone from the text.

Facts come as replacements of token sequences by numbers (`given.lines` -> 0) and as families of enumerators with
those alive (KERNEL_*: {KERNEL_SOFT3}): a comparison with a dead one is 0, its `case` is gone. What follows from
them is worked out on the text itself: && || ! ?: and if. Everything else stays as it was written, so a fact that is
not known costs size and nothing else.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from blobscript.emitting.lexing import Token, blank, closing, following, lexed, preceding, printed

__all__ = ["Facts", "folded"]

#: An operand starts behind these and ends before those.
_STARTS = frozenset({"(", "[", "{", "}", ";", ",", "?", ":", "=", "&&", "||", "return", "!", ""})
_ENDS = frozenset({")", "]", "}", ";", ",", "?", ":", "&&", "||", ""})
_STOPS = frozenset({"(", "[", "{", "}", ";", ",", "?", ":", "=", "+=", "-=", "*=", "/=", "&=", "|=", "||", "return"})


Patterns = dict[str, list[tuple[list[str], str]]]


@dataclass(frozen=True)
class Facts:
    """known: C text -> what stands for it, mostly a number; behind "name: " it holds in that function. dead, sole:
    enumerators that cannot be, and those that alone can be in their family. loops: macros that head a statement.
    cases: macros that stand for a `case`, their enumerator first."""

    known: Mapping[str, str] = field(default_factory=dict[str, str])
    dead: frozenset[str] = frozenset()
    sole: frozenset[str] = frozenset()
    loops: frozenset[str] = frozenset()
    cases: frozenset[str] = frozenset()

    def patterns(self, names: Collection[str]) -> Patterns:
        """What is known in the function or macro of that name, by the first word, the longest first."""
        found: Patterns = {}
        for expression, value in self.known.items():
            place, separate, rest = expression.rpartition(": ")
            if not separate or place in names:
                words = [token.text for token in lexed(rest) if not blank(token)]
                found.setdefault(words[0], []).append((words, value))
        for choices in found.values():
            choices.sort(key=lambda choice: -len(choice[0]))
        return found


def folded(text: str, facts: Facts, names: Collection[str] = ()) -> str:
    """One declaration or definition, or the body of a macro, that declares `names`."""
    tokens = [_inner(token, facts) for token in lexed(text)]
    work = _Folder(tokens, facts, facts.patterns(names))
    work.run()
    return printed(work.tokens)


def _inner(token: Token, facts: Facts) -> Token:
    """A macro defined within a function."""
    if token.kind == "directive" and token.text.lstrip().startswith("#define"):
        head, _, body = token.text.partition(")") if "(" in token.text.split()[1] else token.text.partition(" ")
        return Token("directive", f"{head}){folded(body, facts)}" if "(" in token.text.split()[1] else token.text)
    return token


class _Folder:
    def __init__(self, tokens: list[Token], facts: Facts, patterns: Patterns) -> None:
        self.tokens, self.facts, self.patterns = tokens, facts, patterns

    def run(self) -> None:
        self._replace_known()
        self._compare()
        rules = (
            self._not,
            self._parentheses,
            self._logic,
            self._choice,
            self._order,
            self._if,
            self._for,
            self._switch,
            self._case,
            self._constant,
            self._dead_end,
        )
        while any(rule() for rule in rules):
            pass

    # ---- looking ------------------------------------------------------------------------------------

    def _text(self, i: int) -> str:
        return self.tokens[i].text if 0 <= i < len(self.tokens) else ""

    def _after(self, i: int) -> int:
        return following(self.tokens, i)

    def _before(self, i: int) -> int:
        return preceding(self.tokens, i)

    def _literals(self) -> list[int]:
        """Places of 0 and 1 that are a whole operand of a condition."""
        found: list[int] = []
        for i, token in enumerate(self.tokens):
            if token.kind != "number" or token.text not in ("0", "1"):
                continue
            if self._text(self._before(i)) in _STARTS and self._text(self._after(i)) in _ENDS:
                found.append(i)
        return found

    def _left(self, i: int, *more: str) -> int:
        """Where the operand that ends before i starts."""
        depth, k = 0, self._before(i)
        while k >= 0:
            text = self._text(k)
            if text in (")", "]", "}"):
                depth += 1
            elif depth and text in ("(", "[", "{"):
                depth -= 1
            elif depth == 0 and (text in _STOPS or text in more):
                break
            k = self._before(k)
        return self._after(k)

    def _right(self, i: int, *stops: str) -> int:
        """Where the operand that starts behind i ends: the last token of it."""
        depth, k, last, choices = 0, self._after(i), i, 0
        while k < len(self.tokens):
            text = self._text(k)
            if depth == 0 and text in (")", "]", "}", ";", ",", *stops) and not (text == ":" and choices):
                break
            depth += (text in ("(", "[", "{")) - (text in (")", "]", "}"))
            if depth == 0 and ":" in stops:
                choices += (text == "?") - (text == ":")
            last = k
            k = self._after(k)
        return last

    # ---- changing -------------------------------------------------------------------------------------

    def _put(self, start: int, end: int, tokens: list[Token]) -> bool:
        """tokens for [start, end]."""
        self.tokens[start : end + 1] = tokens
        return True

    def _cut(self, start: int, end: int) -> bool:
        """Removes [start, end], and the white space before it where both sides have some."""
        if start > 0 and self.tokens[start - 1].kind == "space" and "\n" not in self.tokens[start - 1].text:
            start -= 1
        return self._put(start, end, [])

    # ---- facts ----------------------------------------------------------------------------------------

    def _replace_known(self) -> None:
        i = 0
        while i < len(self.tokens):
            for words, value in self.patterns.get(self.tokens[i].text, ()):
                end = self._match(words, i)
                if end >= 0 and self._text(self._before(i)) not in (".", "->"):
                    self._put(i, end, lexed(value))
                    break
            i += 1

    def _match(self, words: list[str], i: int) -> int:
        """Index of the last token of `words`, which start at i; -1: they do not."""
        k = i
        for number, word in enumerate(words):
            if number:
                k = self._after(k)
            if self._text(k) != word:
                return -1
        return k

    def _compare(self) -> None:
        """x == DEAD and x != DEAD, whatever x is."""
        i = 0
        while i < len(self.tokens):
            name = self._text(i)
            sign = self._before(i)
            if self._text(sign) in ("==", "!=") and (name in self.facts.dead or name in self.facts.sole):
                start = self._left(sign, "&&")
                equal = (self._text(sign) == "==") == (name in self.facts.sole)
                self._put(start, i, [Token("number", "1" if equal else "0")])
                i = start
            i += 1

    # ---- expressions -----------------------------------------------------------------------------------

    def _not(self) -> bool:
        for i in self._literals():
            sign = self._before(i)
            if self._text(sign) == "!":
                return self._put(sign, i, [Token("number", "1" if self._text(i) == "0" else "0")])
        return False

    def _parentheses(self) -> bool:
        """(0) as an operand: not the condition of a statement, not an argument."""
        for i in self._literals():
            start, end = self._before(i), self._after(i)
            if self._text(start) == "(" and self._text(end) == ")":
                outer = self._before(start)
                if self._text(outer) in _STARTS and self._text(outer) not in (")", "]"):
                    return self._put(start, end, [self.tokens[i]])
        return False

    def _logic(self) -> bool:
        for i in self._literals():
            value, before, after = self._text(i), self._before(i), self._after(i)
            for sign, winner in (("&&", "0"), ("||", "1")):
                stops = ("&&", "||", "?", ":") if sign == "&&" else ("||", "?", ":")
                if self._text(after) == sign and self._text(before) != "&&":
                    if value == winner:
                        return self._put(i, self._right(after, *stops), [self.tokens[i]])
                    return self._put(i, self._after(after) - 1, [])
                if self._text(before) == sign and (sign == "||" or self._text(after) != ""):
                    if self._text(after) == "&&" and sign == "||":
                        continue
                    if value == winner:
                        return self._put(self._left(before, "&&" if sign == "&&" else "||"), i, [self.tokens[i]])
                    return self._cut(before, i)
        return False

    def _choice(self) -> bool:
        for i in self._literals():
            mark = self._after(i)
            if self._text(mark) != "?" or self._text(self._before(i)) in ("&&", "||", "!"):
                continue
            first_end = self._right(mark, ":")
            colon = self._after(first_end)
            second_end = self._right(colon, ":")
            chosen = (self._after(mark), first_end) if self._text(i) == "1" else (self._after(colon), second_end)
            return self._put(i, second_end, self.tokens[chosen[0] : chosen[1] + 1])
        return False

    def _order(self) -> bool:
        """Two whole numbers compared."""
        for i, token in enumerate(self.tokens):
            if token.text not in _COMPARISONS or token.kind != "sign":
                continue
            left, right = self._number(self._before(i), -1), self._number(self._after(i), 1)
            if left is None or right is None:
                continue
            if self._text(self._before(left[0])) in _STARTS and self._text(self._after(right[1])) in _ENDS:
                outcome = _COMPARISONS[token.text](left[2], right[2])
                return self._put(left[0], right[1], [Token("number", str(int(outcome)))])
        return False

    def _number(self, i: int, way: int) -> tuple[int, int, int] | None:
        """A whole number, perhaps with a sign, from or up to i: first and last token, and value."""
        start = end = i
        if way > 0 and self._text(i) == "-":
            end = self._after(i)
        elif way < 0 and self._text(self._before(i)) == "-" and self._text(self._before(self._before(i))) in _STARTS:
            start = self._before(i)
        digits = self._text(end)
        if not digits.isdigit():
            return None
        return start, end, -int(digits) if self._text(start) == "-" else int(digits)

    def _constant(self) -> bool:
        """const int32_t name = -1; put where the name stands."""
        for i, token in enumerate(self.tokens):
            if token.text != "const" or not self._text(self._after(i)).startswith("int"):
                continue
            name = self._after(self._after(i))
            equal = self._after(name)
            value = self._number(self._after(equal), 1) if self._text(equal) == "=" else None
            if value is None or self._text(self._after(value[1])) != ";":
                continue
            word, number = self._text(name), str(value[2])
            end = self._after(value[1])
            rest = self.tokens[end + 1 :]
            for k, other in enumerate(rest):
                if other.text == word and rest[max(preceding(rest, k), 0)].text not in (".", "->"):
                    rest[k] = Token("number", number)
            self.tokens[end + 1 :] = [part for t in rest for part in (lexed(t.text) if t.text == number else [t])]
            return self._cut_lines(i, end)
        return False

    # ---- statements ------------------------------------------------------------------------------------

    def _statement(self, i: int) -> int:
        """The last token of the statement that starts at i."""
        text = self._text(i)
        if text == "{":
            return closing(self.tokens, i)
        if text in ("if", "for", "while", "switch") or text in self.facts.loops:
            end = self._statement(self._after(closing(self.tokens, self._after(i))))
            if text == "if" and self._text(self._after(end)) == "else":
                end = self._statement(self._after(self._after(end)))
            return end
        if text == "do":
            body = self._statement(self._after(i))
            return self._after(closing(self.tokens, self._after(self._after(body))))
        if text.isupper() and len(text) > 1 and self._text(self._after(i)) == "(":
            end = closing(self.tokens, self._after(i))
            return self._after(end) if self._text(self._after(end)) == ";" else end
        depth = 0
        while i < len(self.tokens):
            text = self._text(i)
            depth += (text in ("(", "[", "{")) - (text in (")", "]", "}"))
            if depth == 0 and text == ";":
                return i
            i = self._after(i)
        return len(self.tokens) - 1

    def _if(self) -> bool:
        for i, token in enumerate(self.tokens):
            if token.text not in ("if", "while") or token.kind != "name":
                continue
            start = self._after(i)
            value = self._after(start)
            end = self._after(value)
            if self._text(start) != "(" or self._text(value) not in ("0", "1") or self._text(end) != ")":
                continue
            if token.text == "while" and self._text(value) == "1":
                continue
            return self._take_branch(i, end, self._text(value) == "1")
        return False

    def _for(self) -> bool:
        """A loop whose condition never holds."""
        for i, token in enumerate(self.tokens):
            start = self._after(i)
            if token.text != "for" or token.kind != "name" or self._text(start) != "(":
                continue
            k = start
            while self._text(k) != ";":
                k = self._after(k)
            words = [self._text(self._after(k)), self._text(self._after(self._after(k)))]
            name, zero, end = words[0], self._after(self._after(self._after(k))), closing(self.tokens, start)
            starts_at_0 = [t.text for t in self.tokens[start:k] if not blank(t)][-3:] == [name, "=", "0"]
            if starts_at_0 and words[1] == "<" and self._text(zero) == "0" and self._text(self._after(zero)) == ";":
                return self._take_branch(i, end, False)
        return False

    def _take_branch(self, i: int, end: int, yes: bool) -> bool:
        first = self._after(end)
        first_end = self._statement(first)
        otherwise = self._after(first_end)
        has_else = self._text(i) == "if" and self._text(otherwise) == "else"
        second = self._after(otherwise) if has_else else -1
        last = self._statement(second) if has_else else first_end
        before = self._before(i)
        if yes or has_else:
            start, stop = (first, first_end) if yes else (second, last)
            lone = self._text(before) in ("else", ")")  # needs to stay one statement
            return self._put(i, last, self.tokens[start : stop + 1] if lone else self._unwrapped(start, stop))
        if self._text(before) == "else":
            return self._cut(before, last)
        if self._text(before) == ")" and self._heads(before):
            return self._put(i, last, lexed("{ }"))
        return self._cut_lines(i, last)

    def _dead_end(self) -> bool:
        """What stands behind a return in its block, or behind a block that ends with one."""
        for i, token in enumerate(self.tokens):
            if token.text not in ("return", "{") or self._text(self._before(i)) not in ("{", ";", "}"):
                continue
            if token.text == "{" and not self._returns(i):
                continue
            end = self._statement(i)
            k = last = self._after(end)
            while k < len(self.tokens) and self._text(k) not in ("}", "case", "default"):
                last = self._statement(k)
                k = self._after(last)
            if k > self._after(end) and k < len(self.tokens):
                return self._put(end + 1, last, [])
        return False

    def _returns(self, i: int) -> bool:
        """Is a return the last statement of the block that starts at i?"""
        end, k, last = closing(self.tokens, i), self._after(i), ""
        while k < end:
            last = self._text(k)
            k = self._after(self._statement(k))
        return last == "return"

    def _heads(self, i: int) -> bool:
        """Does the parenthesis that closes at i belong to if, for, while or a loop macro?"""
        depth, k = 0, i
        while k >= 0:
            depth += (self._text(k) == ")") - (self._text(k) == "(")
            if depth == 0:
                return self._text(self._before(k)) in {"if", "for", "while", "switch", *self.facts.loops}
            k = self._before(k)
        return False

    def _cut_lines(self, start: int, end: int) -> bool:
        """Removes statements, with the space before them: their lines are gone."""
        while start > 0 and self.tokens[start - 1].kind == "space":
            start -= 1
        return self._put(start, end, [])

    def _unwrapped(self, start: int, end: int) -> list[Token]:
        """A statement in the place of the `if` around it; a block without declarations loses its braces."""
        if self._text(start) != "{":
            return self.tokens[start : end + 1]
        inner = self._after(start)
        while inner < end:
            first, second = self.tokens[inner], self.tokens[self._after(inner)]
            declares = first.text in ("const", "static", "struct") or (
                first.kind == "name" and (second.kind == "name" or second.text == "*") and first.text not in _KEYWORDS
            )
            if declares:
                return self.tokens[start : end + 1]
            inner = self._after(self._statement(inner))
        body = self.tokens[self._after(start) : self._before(end) + 1]
        for token in body:
            if token.kind == "space" and "\n    " in token.text:
                token.text = token.text.replace("\n    ", "\n")
        return body

    def _switch(self) -> bool:
        """A switch over a family of which one member is alone: what that one does."""
        for i, token in enumerate(self.tokens):
            if token.text != "switch" or token.kind != "name":
                continue
            start = self._after(closing(self.tokens, self._after(i)))
            end = closing(self.tokens, start)
            for k in range(start, end):
                if self.tokens[k].text == "case" and self._text(self._after(k)) in self.facts.sole:
                    return self._put(i, end, self._section(self._after(self._after(self._after(k))), end))
        return False

    def _section(self, start: int, end: int) -> list[Token]:
        """The statements behind a label, up to the next one, without the last `break`."""
        last, k = start, start
        while k < end and self._text(k) not in ("case", "default", "break"):
            last = self._statement(k)
            k = self._after(last)
        return self._unwrapped(start, last) if self._text(start) == "{" else self.tokens[start : last + 1]

    def _case(self) -> bool:
        """`case DEAD:` with what belongs to it alone, and macros that stand for one."""
        for i, token in enumerate(self.tokens):
            if token.text == "case" and self._text(self._after(i)) in self.facts.dead:
                return self._cut_case(i)
            first = self._after(i)
            second = self._after(first)
            if token.text == "[" and self._text(first) in self.facts.dead and self._text(self._after(second)) == "=":
                return self._cut_entry(i)
            if token.text in self.facts.cases and self._text(first) == "(" and self._text(second) in self.facts.dead:
                return self._cut_lines(i, closing(self.tokens, first))
        return False

    def _cut_entry(self, i: int) -> bool:
        """[DEAD] = …, in an initialiser."""
        value = self._after(self._after(self._after(self._after(i))))
        end = closing(self.tokens, value) if self._text(value) == "{" else self._right(value)
        if self._text(self._after(end)) == ",":
            end = self._after(end)
        elif self._text(self._before(i)) == ",":
            i = self._before(i)
        return self._cut_lines(i, end)

    def _cut_case(self, i: int) -> bool:
        colon = self._after(self._after(i))
        nearest = self._text(self._before(i))
        last, k = colon, self._after(colon)
        if nearest == ":":  # another label before shares the statements
            return self._cut_lines(i, colon)
        while k < len(self.tokens) and self._text(k) not in ("case", "default", "}"):
            last = self._statement(k)
            k = self._after(last)
        return self._cut_lines(i, last)


_COMPARISONS: dict[str, Callable[[int, int], bool]] = {
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}

_KEYWORDS = frozenset({"return", "else", "case", "goto", "sizeof", "break", "continue", "default"})
