"""What errors, or their spread, depend on and the model leaves out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.stats import t as student

from resim.core.geometry import Floats
from resim.perception.model import Assumption, FailedAssumption, Quantity
from resim.perception.parameters import PER, UNITS
from resim.perception.training.clusters import FEWEST
from resim.perception.training.errors import NEGLIGIBLE
from resim.perception.training.residuals import BEYOND, Regression, Residuals
from resim.perception.training.single import LEAST_LATE, LEAST_SHARE

WORDS = {
    "range": "range", "bearing": "bearing", "relative_speed": "relative speed", "acceleration": "acceleration",
    "speed": "the object's speed", "ego_speed": "the EGO's speed", "braking": "braking", "time": "time in the drive",
}  # fmt: skip
FEATURES_OF = ("range", "bearing", "relative_speed", "acceleration", "speed")
OF = {"ego_speed": "m/s", "time": "s", **{name: UNITS[name] for name in FEATURES_OF}}


class Dependence:
    """What errors, or their spread, depend on beyond the model: the most telling first, then what it leaves."""

    def __init__(
        self, quantity: Quantity, r: Residuals, regression: Regression, base: list[str], *, spread: bool
    ) -> None:
        self.quantity, self.r, self.regression, self.base, self.spread = quantity, r, regression, base, spread
        self.drives = len(regression.normal)
        self.first = self.looked(base) if self.drives >= FEWEST else {}
        self.count = len(self.first)

    def looked(self, base: Sequence[str]) -> dict[str, tuple[float, Floats, Floats]]:
        """Give p, coefficients and standard errors of each that is not in the base."""
        out = {}
        for name in self.regression.names:
            known = any(name.startswith("braking") and b.startswith("braking") for b in base)
            lines = [BEYOND[n] for n in (*base, name) if n in BEYOND]
            under = list(dict.fromkeys(n for n in (*base, *lines) if n != name))
            if known or name in base or (found := self.regression.judged(under, name)) is None:
                continue
            z = found[0][-1] / found[1][-1]
            varies = self.spread and name == "latency"
            p = student.sf(z, self.drives - 1) if varies else 2.0 * student.sf(abs(z), self.drives - 1)
            if np.isfinite(p):  # else there is nothing that varies
                out[name] = (float(p), *found)
        return out

    def failures(self, level: float) -> Iterator[FailedAssumption]:
        """Give what is surely there, and no trifle."""
        base, looked = list(self.base), self.first
        while looked:
            name = min(looked, key=lambda n: looked[n][0])
            if name == "ego_speed" and looked.get("speed", (1.0,))[0] < level:
                name = (
                    "speed"  # both differ by the relative speed only; an object's own is the likelier cause
                )
            p, found, se = looked[name]
            if p >= level:
                return
            told = (
                self.of_spread(name, float(found[-1])) if self.spread else self.of_mean(name, base, found, se)
            )
            if told is not None:
                assumption: Assumption = "spread" if self.spread else "bias"
                assumption = "latency" if self.spread and name == "latency" else assumption
                size, unit, text = told
                yield FailedAssumption(
                    quantity=self.quantity,
                    assumption=assumption,
                    on="braking" if name.startswith("braking") else name,
                    size=size,
                    unit=unit,
                    p=p,
                    text=text,
                )
            base.append(name)
            looked = self.looked(base)

    def of_mean(
        self, name: str, base: Sequence[str], found: Floats, se: Floats
    ) -> tuple[float, str, str] | None:
        """Give size, unit and words of a dependence of the mean."""
        own = UNITS[self.quantity]
        size, text = self.in_words(name, float(found[-1]))
        if size < NEGLIGIBLE[self.quantity]:
            return None
        at = list(base).index("latency") if "latency" in base else None
        if at is not None and abs(found[at]) > max(3.0 * se[at], 0.01):
            late = self.r.fitted.aligned.late
            text += f"; mistaken for latency: {late + found[at]:.3g} s instead of {late:.3g} s"
        return size, own, text

    def in_words(self, name: str, slope: float) -> tuple[float, str]:
        """Give how far a dependence of the mean moves errors, and say so."""
        own, error = UNITS[self.quantity], f"{self.quantity} error"
        if name == "range_bend":
            ends = self.off_line(slope)
            off_line = " and ".join(f"{off:+.3g} {own} at {at:.3g} m" for at, off in ends)
            text = f"{error} bends with range: off a straight line by {off_line}"
            return max(abs(off) for _, off in ends), text
        if name == "bearing_side":
            text = f"{error} jumps between the sides: {slope:+.3g} {own} on the left against the right"
            return abs(slope), text
        low, high = self.span(name)
        size = abs(slope) * (high - low)
        if name.startswith("braking"):
            return size, f"{error} is off by {slope:+.3g} {own} while an object brakes"
        per = PER[own, OF[name]] if (own, OF[name]) in PER else f"{own}/{OF[name]}"
        scale = f" ({slope:+.1%})" if name == "speed" == self.quantity else ""
        return size, (
            f"{error} depends on {WORDS[name]}: {slope:+.3g} {per}{scale}, {size:.3g} {own} between {low:.3g} and "
            f"{high:.3g} {OF[name]}"
        )

    def off_line(self, bend: float) -> list[tuple[float, float]]:
        """Give how far an error that bends is off its line at the ends of the ranges: range [m] and error."""
        ranges, off = (self.values(name)[self.r.known] for name in ("range", "range_bend"))
        ends = [int(np.argmin(np.abs(ranges - end))) for end in self.span("range")]
        return [(float(ranges[k]), bend * float(off[k])) for k in ends]

    def of_spread(self, name: str, slope: float) -> tuple[float, str, str] | None:
        """Give size, unit and words of a dependence of the spread."""
        own, r = UNITS[self.quantity], self.r
        typical = float(np.sqrt(np.mean(r.spread[r.known] ** 2)))
        if name == "latency":
            size = float(np.sqrt(max(slope, 0.0)))
            text = f"the latency of {self.quantity} varies by {size:.3g} s from list to list"
            return (size, "s", text) if size > LEAST_LATE else None
        low, high = self.span(name)
        values = self.values(name)[r.known]
        ends = [float(np.sqrt(max(1.0 + slope * (end - values.mean()), 0.01))) for end in (low, high)]
        size = abs(ends[1] - ends[0]) * typical
        if abs(ends[1] - ends[0]) < LEAST_SHARE or size < NEGLIGIBLE[self.quantity]:
            return None
        if name == "braking":
            where = "while an object brakes, else"
        else:
            where = f"at {WORDS[name]} of {high:.3g} {OF[name]}, at {low:.3g} {OF[name]}"
        text = (
            f"spread of {self.quantity} errors depends on {WORDS[name]}: {ends[1]:.2f} times the model's {where} "
            f"{ends[0]:.2f} times, of {typical:.3g} {own}"
        )
        return size, own, text

    def values(self, name: str) -> Floats:
        """Give the variable (R, T) as it enters."""
        raw = self.r.raw[name]
        return np.abs(raw) if self.spread and name in ("bearing", "relative_speed", "acceleration") else raw

    def span(self, name: str) -> tuple[float, float]:
        """Give the values between which 90 % lie."""
        values = self.values(name)[self.r.known]
        if name.startswith("braking"):
            return 0.0, 1.0
        low, high = np.quantile(values, (0.05, 0.95))
        return float(low), float(high)
