"""Cross-verification: does simulation give the measured drive's verdicts, and do two builds differ?

Compares what drives came to (`Outcome`); runs nothing (Groh 2018, III.B and III.C; Wagner 2021, 5.1 and 5.3.2).
"""
