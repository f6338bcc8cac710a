"""SciPy's bootstrap and Wilcoxon test on the resamples that `depthloom compare` draws.

SciPy draws with NumPy's generators. It is given one that draws as we do (SplitMix64, a sequence of its own for every resample), so that its intervals
and ours are of the same resamples, and have to be the same numbers.
"""
import numpy as np
from scipy import stats

STEP = np.uint64(0x9E3779B97F4A7C15)


def mix(state):
    z = state + STEP
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


class Ours(np.random.Generator):
    """Draws resample `r` of a seed from the state `mix(seed) ^ rotate(mix(r), 32)`."""

    def __new__(cls, seed):
        return super().__new__(cls)

    def __init__(self, seed):
        super().__init__(np.random.PCG64(0))
        self.seed = seed
        self.drawn = 0

    def integers(self, low, high=None, size=None, **_):
        assert low == 0, "bootstrap draws indices"
        resamples, frames = size
        part = mix(np.arange(self.drawn, self.drawn + resamples, dtype=np.uint64))
        self.drawn += resamples
        state = mix(np.array([self.seed], dtype=np.uint64)) ^ ((part << np.uint64(32)) | (part >> np.uint64(32)))
        steps = np.arange(frames, dtype=np.uint64) * STEP
        bits = mix(state[:, None] + steps[None, :]) >> np.uint64(32)
        # In the order of frames: what a resample is worth has nothing to do with the order they are drawn in.
        return np.sort(((bits * np.uint64(high)) >> np.uint64(32)).astype(np.int64), axis=1)


def value(terms, form, axis):
    """A data set's value, from what frames weigh and what is summed: as `statistics/weighted.rs`."""
    weight, first, second = (np.sum(term, axis=axis) for term in terms)
    if form == "mean":
        return first / weight
    if form == "root mean":
        return np.sqrt(first / weight)
    return 0.5 * (second / weight - (first / weight) ** 2)


def interval(one, two, form="mean", method="BCa", confidence=0.95, resamples=10_000, seed=1):
    """The interval of the difference, of frames' terms: three lists each, or one, of values that weigh the same."""
    def terms(of):
        of = np.asarray(of, dtype=np.float64)
        return [np.ones_like(of), of, np.zeros_like(of)] if of.ndim == 1 else list(of)

    one, two = terms(one), terms(two)

    def difference(*data, axis=-1):
        return value(data[3:], form, axis) - value(data[:3], form, axis)

    with np.errstate(all="ignore"):
        found = stats.bootstrap(
            (*one, *two), difference, paired=True, vectorized=True, n_resamples=resamples, method=method,
            confidence_level=confidence, rng=Ours(seed), batch=1000, axis=-1)
    return [float(found.confidence_interval.low), float(found.confidence_interval.high)]


def wilcoxon(differences):
    return float(stats.wilcoxon(np.asarray(differences, dtype=np.float64), zero_method="wilcox", method="auto").pvalue)


def holm(p):
    """As `statsmodels.stats.multitest.multipletests(p, method="holm")`."""
    p = np.asarray(p, dtype=np.float64)
    order = np.argsort(p, kind="stable")
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    return corrected.tolist()
