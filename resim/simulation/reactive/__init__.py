"""Traffic that reacts: who is handed over from its trace to a driver, how that driver drives, and when it is back."""
