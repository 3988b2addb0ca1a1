"""Where the parser is stuck: what to tell people, and how to go on.

`diagnose` asks a list of rules, each for one kind of mistake, from the most particular to the most
general. A rule looks at the tokens around the stuck one and at what the parser would accept, and
answers with a finding and, if it can guess what was meant, the change to the tokens that mends it.
Nobody is told what an LALR automaton expected: a finding says what is missing, in the script's words.
"""

from __future__ import annotations

from collections.abc import Callable

from blobscript import snag_commas, snag_gaps, snag_habits, snag_signs, snag_words
from blobscript.machine import Machine
from blobscript.source import Source
from blobscript.stuck import Repair, Snag, Stuck

__all__ = ["Repair", "Snag", "diagnose"]


def diagnose(machine: Machine, source: Source, item: int) -> Snag:
    """The finding for a stuck parser; `item` is the index of the first token of the item it is in."""
    stuck = Stuck(machine, source, item)
    for rule in _RULES:
        snag = rule(stuck)
        if snag is not None:
            return snag
    return snag_gaps.anything(stuck)


_RULES: tuple[Callable[[Stuck], Snag | None], ...] = (
    snag_words.reserved_name,
    snag_signs.half_number,
    snag_habits.block_comment,
    snag_habits.lambda_word,
    snag_habits.list_for_a_range,
    snag_words.header,
    snag_words.header_goes_on,
    snag_words.foreign,
    snag_words.else_if,
    snag_words.turned_import,
    snag_words.bare_part,
    snag_words.lonely_else,
    snag_words.late_header,
    snag_words.lonely_return,
    snag_words.top_only,
    snag_signs.doubled,
    snag_signs.assignment,
    snag_signs.double_equal,
    snag_signs.colon,
    snag_signs.loop_in,
    snag_gaps.missing_parameters,
    snag_gaps.missing_name,
    snag_signs.missing_equal,
    snag_signs.chained,
    snag_gaps.missing_return,
    snag_gaps.after_return,
    snag_commas.comma_in_block,
    snag_commas.missing_times,
    snag_habits.transform_in_front,
    snag_habits.turned_comprehension,
    snag_commas.two_items,
    snag_commas.missing_comma,
    snag_gaps.missing_block,
    snag_gaps.missing_else,
    snag_gaps.missing_member,
    snag_gaps.missing_value,
    snag_habits.braces_for_a_record,
    snag_gaps.block_on_nothing,
    snag_gaps.unfinished_definition,
)
