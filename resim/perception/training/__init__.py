"""Training: matched drives in, a perception model out.

drive     a recording as lists in the EGO's frame, with the truth as splines (truth)
matching  which perceived object is which true one
samples   the matched samples as arrays, the truth at any latency
errors    latencies and biases (alignment, gauss_newton), drift and noise (spread, by the filter whiten), in turn
coupling, maneuvers, localisation, detection, lists   the other parts of the model
clusters  what is sure, by how drives differ
fit       whether the model fits: what is left of the errors (residuals), tested (single, dependence); left_out: counted
"""

from resim.perception.training.train import train

__all__ = ["train"]
