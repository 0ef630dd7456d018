"""Cross-verification: does simulation give the measured drive's verdicts, and do two builds differ?

Compares what drives came to (`DriveOutcome`). What it drives itself is a build in open loop, and variations of a drive
(Groh 2018, III.B and III.C; Wagner 2021, 5.1 and 5.3.2).
"""
