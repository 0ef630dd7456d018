"""The scenario space: which kinds of scenario there are, how much of them was seen, how risky they are, and whether a
function may be released (Wagner 2021, 6.2.3, 6.2.4, 6.3)."""
