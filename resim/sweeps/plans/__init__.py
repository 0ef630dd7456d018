"""Plans of a sweep, which values are run: one file each. A new one needs its file, and a line here."""
# ruff: noqa: F401  each file adds its plan to the registry

import resim.sweeps.plans.adaptive
import resim.sweeps.plans.grid
import resim.sweeps.plans.halton
import resim.sweeps.plans.latin_hypercube
import resim.sweeps.plans.one_at_a_time
import resim.sweeps.plans.sobol
