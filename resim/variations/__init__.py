"""Local variation of measured scenarios: neighbours that a human could have driven (Wagner 2021, 6.1)."""
