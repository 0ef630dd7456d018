"""Damaged inputs for every reader of resim, and what becomes of them."""
