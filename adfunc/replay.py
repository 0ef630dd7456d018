"""An oracle: places the EGO on its recorded trace, past the vehicle model.

With it every simulation error must be zero; what is left is the pipeline's own fault.
"""

from __future__ import annotations

from resim.simulation.function.interface import Perceived, Placement, Setup


class Replay:
    """Answers the recorded state of the next step."""

    needs_truth = True

    def reset(self, setup: Setup) -> None:
        """Take the record."""
        assert setup.recorded is not None
        self.recorded, self.cycle = setup.recorded, setup.cycle

    def step(self, perceived: Perceived) -> Placement:
        """Place the EGO."""
        return Placement(self.recorded(perceived.t + self.cycle))

    def close(self) -> None:
        """Nothing to end."""
