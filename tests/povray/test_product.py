"""A share of the whole product of what POV-Ray can express; bench/pov_campaign.py goes through all of it."""

from __future__ import annotations

import numpy as np
from povray import product


def test_a_share_of_the_product_agrees() -> None:
    """One per cent of the cases, the first of the campaign's."""
    chosen = np.random.default_rng(2).permutation(len(product.PRODUCT))[:27].tolist()
    found = product.compared(chosen, 60)
    assert found.hits > 300
    assert found.ours == []
    assert len(found.theirs) <= 1e-3 * found.rays, found.theirs


def test_negative_constants_in_smooth_joints() -> None:
    """Inside of a solid its density is a number, and a smooth minimum turns signs: `--1` is nothing POV-Ray reads."""
    found = product.compared([1631], 600)
    assert found.hits > 3
    assert found.ours == found.theirs == []


def test_all_of_it_is_there() -> None:
    for column, count in enumerate((10, 7, 7, 3, 2)):
        assert len({str(row[column]) for row in product.PRODUCT}) == count
    assert len(product.PRODUCT) == 10 * 7 * 3 * (6 * 2 + 1)
