"""The sentences that say which method to take and why: every clause follows from the figures at hand."""

from __future__ import annotations

import math

from blobscript.reporting.indexes import IndexResult
from blobscript.reporting.judging import RULE_OF_THREE
from blobscript.reporting.meshes import MeshResult
from blobscript.reporting.normals import NormalResult
from blobscript.reporting.pov import PovRay, variant_words
from blobscript.reporting.sampling import Sampling
from blobscript.reporting.searches import Result
from blobscript.reporting.words import count, factor, joined, length, micro, percent, plural, seconds

__all__ = [
    "best_search",
    "index_sentence",
    "mesh_sentence",
    "normal_sentence",
    "pareto",
    "povray_sentence",
    "proof_sentence",
    "sampling_sentence",
    "search_sentences",
    "setting_words",
]

#: Times closer than this share are taken for equal, whatever the spread says.
_ALIKE = 0.12


def setting_words(result: Result) -> str:
    """`sandwich` · `sphere, tolerance 1e-6 units`."""
    method = result.method
    if method.step is not None:
        return f"{method.search}, step {result.setting:g} units"
    return method.search if method.is_default else f"{method.search}, tolerance {length(result.setting)} units"


def pareto(results: list[Result]) -> list[Result]:
    """Faultless ones that no other faultless one beats in both time and largest error, the quickest first."""
    front: list[Result] = []
    for result in sorted((r for r in results if r.faultless), key=lambda r: (r.time.least, r.judgement.errors.max)):
        worst = result.judgement.errors.max
        if not front or worst < front[-1].judgement.errors.max:
            front.append(result)
    return front


def best_search(results: list[Result]) -> Result | None:
    """Of the faultless ones about as quick as the quickest faultless one: proved before not, exact to rounding
    before not, the default setting before others. None where no search is faultless."""
    good = [r for r in results if r.faultless]
    if not good:
        return None
    exact = [r for r in good if _is_exact(r)] or good
    limit = (1.0 + _ALIKE) * min(r.time.least for r in exact)
    near = [r for r in exact if r.time.least <= limit]
    return min(near, key=lambda r: (not r.method.proved, not r.method.is_default, r.time.least))


def _is_exact(result: Result) -> bool:
    """No error beyond what rounding makes unavoidable."""
    return not result.judgement.errors.conditioned > 1.0


def search_sentences(results: list[Result]) -> list[str]:
    counts = results[0].judgement.all
    if counts.hits == 0:
        return [f"No ray meets a surface: {plural(counts.rays, 'ray')}, every one a certified miss."]
    best = best_search(results)
    if best is None:
        least = min(results, key=lambda r: (r.judgement.all.bad, r.time.least))
        return [
            f"No search is right on all {count(counts.rays)} rays; the fewest mistakes, "
            f"{count(least.judgement.all.bad)}, makes {setting_words(least)}."
        ]
    told = [
        _advice(best, results),
        _figures(best),
        _against_default(best, results),
        _without_proof(best, results),
        _quicker(best, results),
    ]
    return [sentence for sentence in told if sentence]


def _advice(best: Result, results: list[Result]) -> str:
    """What to take, and the reasons in a few words."""
    how = "with its default tolerance" if best.method.is_default else f"({setting_words(best).split(', ', 1)[1]})"
    reasons = ["makes no mistake"]
    reasons += ["is exact to rounding"] if _is_exact(best) else []
    reasons += ["proves each answer"] if best.method.proved else []
    rivals = [r for r in results if r.faultless and _is_exact(r) >= _is_exact(best)]
    if best.time.least <= min(r.time.least for r in rivals) * (1.0 + _ALIKE):
        reasons.append("nothing as good is quicker" if len(rivals) > 1 else "nothing else is as good")
    return f"Take {best.method.search} {how}: it {joined(reasons)}."


def _figures(best: Result) -> str:
    counts, errors = best.judgement.all, best.judgement.errors
    share = f", {errors.conditioned:.2g} of what rounding makes unavoidable" if _is_exact(best) else ""
    return (
        f"Of {count(counts.rays)} rays all {plural(counts.hits, 'hit')} are found, none is missed and none false; "
        f"distances are off by at most {length(errors.max)} scene units{share}. "
        f"It takes {micro(best.time.least)} and {best.judgement.evaluations:.3g} evaluations per ray of the picture."
    )


def _against_default(best: Result, results: list[Result]) -> str:
    """Where the choice is not what `render` does by itself; else what comes next."""
    default = next((r for r in results if r.method.search == "sandwich" and r.method.is_default), None)
    if best is not default and default is not None:
        state = "is right as well" if default.faultless else f"gets {plural(default.judgement.all.bad, 'ray')} wrong"
        ratio = default.time.least / best.time.least
        pace = f"takes {factor(ratio)} as long" if ratio > 1.0 + _ALIKE else "takes about as long"
        return f"The default, sandwich, {state} and {pace}."
    others = [r for r in results if r.faultless and _is_exact(r) and r.method.search != best.method.search]
    if not others:
        return "No other search is as exact without a mistake."
    quickest = min(r.time.least for r in others)
    near = [r for r in others if r.time.least <= (1.0 + _ALIKE) * quickest]
    following = min(near, key=lambda r: (not r.method.is_default, r.time.least))
    ratio = following.time.least / best.time.least
    how = f"takes {factor(ratio)} as long" if ratio > 1.0 + _ALIKE else "takes about as long"
    return f"The next that is as exact and faultless, {setting_words(following)}, {how}."


def _without_proof(best: Result, results: list[Result]) -> str:
    """What the fastest faultless search without proof is worth."""
    lucky = [r for r in results if r.faultless and not r.method.proved]
    if not lucky or not best.method.proved:
        return ""
    other = min(lucky, key=lambda r: r.time.least)
    floor = RULE_OF_THREE / other.judgement.all.rays
    ratio = other.time.least / best.time.least
    pace = f"in {factor(ratio)} the time" if abs(ratio - 1.0) > _ALIKE else "in about the same time"
    return (
        f"Without a proof, {setting_words(other)} makes no mistake on these rays either, {pace} and with errors up to "
        f"{length(other.judgement.errors.max)}; that only bounds its share of mistakes by {percent(floor)}."
    )


def _quicker(best: Result, results: list[Result]) -> str:
    """The quickest of all, where it is quicker and pays for it."""
    quickest = min(results, key=lambda r: r.time.least)
    gain = best.time.least / quickest.time.least
    if gain <= 1.0 + _ALIKE:
        return ""
    price = (
        f"gets {plural(quickest.judgement.all.bad, 'ray')} wrong"
        if not quickest.faultless
        else f"is off by up to {length(quickest.judgement.errors.max)} scene units"
    )
    return f"The quickest of all, {setting_words(quickest)}, is {factor(gain)} as quick and {price}."


def proof_sentence(results: list[Result]) -> str:
    """What tolerances cost the searches that prove their answer, and the others."""
    proved = [r for r in results if r.method.proved]
    others = [r for r in results if not r.method.proved]
    if not proved or not others:
        return ""
    spans = [
        max(r.time.least for r in proved if r.method.search == search)
        / min(r.time.least for r in proved if r.method.search == search)
        for search in dict.fromkeys(r.method.search for r in proved)
    ]
    faults = sum(r.judgement.all.bad for r in proved)
    wrong = sum(not r.faultless for r in others)
    mistakes = "none of them makes a mistake" if faults == 0 else f"together they make {plural(faults, 'mistake')}"
    return (
        f"Searches that prove their answer take at most {factor(max(spans))} as long with one tolerance as with "
        f"another, and {mistakes}. Of {count(len(others))} settings of the others {count(wrong)} get rays wrong."
    )


# ---- the other sections ------------------------------------------------------------------------


def index_sentence(results: list[IndexResult]) -> str:
    best = min(results, key=lambda r: r.total)
    alike = [r.index for r in results if r is not best and r.total <= (1.0 + _ALIKE) * best.total]
    slow = max(results, key=lambda r: r.total)
    wrong = [r.index for r in results if r.judgement.all.bad]
    mistakes = f" Mistakes: {joined(wrong)}." if wrong else " All give the right hits."
    if len(alike) == len(results) - 1:
        return f"All indexes take about as long, {seconds(best.total)} for a picture of 640 x 480.{mistakes}"
    equal = f" ({joined(alike)} {'is' if len(alike) == 1 else 'are'} about as quick)" if alike else ""
    return (
        f"For a picture of 640 x 480, built and traced, {best.index} is quickest with {seconds(best.total)}{equal}; "
        f"{slow.index} takes {factor(slow.total / best.total)} as long.{mistakes}"
    )


def normal_sentence(results: list[NormalResult]) -> str:
    analytic = next(r for r in results if r.normals == "analytic")
    differences = [r for r in results if r.normals != "analytic" and not math.isnan(r.errors.max)]
    if not differences or math.isnan(analytic.errors.max):
        return ""
    best = min(differences, key=lambda r: r.errors.max)
    ratio = best.time.least / analytic.time.least
    cost = f"in {factor(ratio)} the time" if abs(ratio - 1.0) > _ALIKE else "in about the same time"
    return (
        f"Analytic normals are exact to {length(analytic.errors.max)} rad; the best of the differences "
        f"({best.normals}, step {length(best.step)} units) reach {length(best.errors.max)} rad, {cost}."
    )


def mesh_sentence(results: list[MeshResult]) -> str:
    finest, coarsest = results[-1], results[0]
    order = _order(results)
    at_which = f" The error falls with the power {order:.2f} of the cell." if not math.isnan(order) else ""
    leaks = sum(r.open_edges > 0 for r in results)
    closed = "All meshes are closed." if not leaks else f"{plural(leaks, 'mesh')} of {len(results)} has open edges."
    if leaks > 1:
        closed = f"{leaks} of {len(results)} meshes have open edges."
    return (
        f"Cells of {finest.cell:.3g} scene units keep the mesh within {length(_worst(finest))} of the surface with "
        f"{count(finest.triangles)} triangles in {seconds(finest.time.least)}; cells of {coarsest.cell:.3g} within "
        f"{length(_worst(coarsest))}.{at_which} {closed}"
    )


def _worst(result: MeshResult) -> float:
    return max((x for x in (result.to_surface.p99, result.to_mesh.p99) if not math.isnan(x)), default=math.nan)


def _order(results: list[MeshResult]) -> float:
    """Slope of log median error over log cell."""
    pairs = [(math.log(r.cell), math.log(r.to_mesh.median)) for r in results if r.to_mesh.median > 0.0]
    if len(pairs) < 3:
        return math.nan
    mean_x, mean_y = (sum(p[k] for p in pairs) / len(pairs) for k in (0, 1))
    return sum((x - mean_x) * (y - mean_y) for x, y in pairs) / sum((x - mean_x) ** 2 for x, _ in pairs)


def sampling_sentence(sampling: Sampling) -> str:
    fixed = sampling.fixed
    first, last = fixed[0], fixed[-1]
    enough = next((r for r in fixed if r.rms <= 1.0 / 255.0), None)
    start = f"One sample a pixel is off by {percent(first.rms)} (root mean square of sRGB)"
    if enough is first:
        return f"{start}, less than one step of 8 bits: more samples do not show."
    if enough is not None:
        cost = factor(enough.time.least / first.time.least)
        start = f"{start}; {enough.samples} samples bring it below one step of 8 bits, in {cost} the time."
    else:
        start = f"{start}; {last.samples} samples by {percent(last.rms)}."
    return " ".join(filter(None, [start, _adaptive_sentence(sampling)]))


def _adaptive_sentence(sampling: Sampling) -> str:
    """The most exact adaptive picture against a fixed number of samples of the same error, between two of them."""
    best = min(sampling.adaptive, key=lambda r: r.rms, default=None)
    around = [
        (a, b)
        for a, b in zip(sampling.fixed, sampling.fixed[1:], strict=False)
        if best is not None and b.rms < best.rms <= a.rms
    ]
    if best is None or not around:
        return ""
    a, b = around[0]
    share = math.log(a.rms / best.rms) / math.log(a.rms / b.rms)
    even = a.time.least * (b.time.least / a.time.least) ** share
    pace = even / best.time.least
    how = f"{factor(pace)} as quick as" if pace > 1.0 + _ALIKE else "no quicker than"
    return f"As many samples as the noise needs ({best.words}) are {how} the same number everywhere of the same error."


def povray_sentence(povray: PovRay, searches: list[Result]) -> str:
    """Its most exact variant without a mistake beside what is taken here."""
    if not povray.results:
        return f"POV-Ray {povray.version} cannot show this scene: {' '.join(povray.refused)}."
    start = f"POV-Ray {povray.version} has the scene as {joined(list(povray.forms))}."
    good = [r for r in povray.results if r.judgement.all.bad == 0]
    if not good:
        least = min(povray.results, key=lambda r: r.judgement.all.bad)
        mistakes = plural(least.judgement.all.bad, "mistake")
        return f"{start} Each variant makes mistakes; the fewest ({mistakes}): {variant_words(least)}."
    exact = min(good, key=lambda r: (r.judgement.errors.max, r.time.least))
    text = (
        f"{start} Without a mistake its most exact variant, {variant_words(exact)}, is off by up to "
        f"{length(exact.judgement.errors.max)} in {micro(exact.time.least)} per ray"
    )
    best = best_search(searches)
    if best is None:
        return f"{text}."
    return f"{text}; {best.method.search} is {factor(exact.time.least / best.time.least)} as quick."
