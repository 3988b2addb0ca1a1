"""A hundredth of the campaign in tests/bench/fuzz.py: no script makes the compiler stumble."""

from __future__ import annotations

from language.fuzzing import SECONDS, Judge, campaign


def test_a_thousand_odd_scripts() -> None:
    with Judge() as judge:
        counts = dict(campaign(judge, 1000))
        assert judge.faults == []
        assert judge.longest < SECONDS
    assert sum(counts.values()) >= 990
    assert min(counts.values()) >= 40
    assert judge.codes[0] > 20, "some are right"
    assert judge.codes[1] > 500


def test_the_judge_sees_what_is_wrong(monkeypatch) -> None:
    """A compiler that dies, and one that takes too long, are found out."""
    monkeypatch.setattr("language.fuzzing.SECONDS", 0.0)
    with Judge() as judge:
        judge(b"let a = 1")
        assert len(judge.faults) == 1
        assert judge._worker is not None
        judge._worker.kill()
        judge(b"let a = 1")
        assert len(judge.faults) == 2
