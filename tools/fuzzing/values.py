"""Values that a careful reader may not have thought of."""

from __future__ import annotations

NUMBERS = (
    "0", "-0", "nan", "inf", "-inf", "1e308", "-1e308", "1e300", "1e160", "1e-320", "-1", "1", "1e9", "1e12", "-1e12",
    "1e15", "1e18", "1e-9", "1e-15", "0.5", "2147483648", "-9223372036854775809", "99999999999999999999", "1e400",
    "65536", "1000", "-1000", "100000", "1e6", "999999.9", "1e5", "-1e5", "9" * 5000,
)  # fmt: skip
TEXTS = (
    "", " ", "0x10", "1_000", "1,5", "\u0663", "\u00bd", "true", "None", " 5 ", "A" * 100_000, "'", "<>&",
    "../../etc/passwd", "\u202e\u00e4\U0001f697", "%s{}", "a b", "1~2", "ego~2", "sd:1", "NULL", "-", "\t", "/dev/zero",
    "x" * 300, "\u212b", "\ufeff",
)  # fmt: skip
WORDS = (
    "road", "junction", "start", "end", "driving", "none", "shoulder", "sidewalk", "bidirectional", "true", "no limit",
    "undefined", "mph", "km/h", "RHT", "LHT", "normalized", "arcLength", "reversed", "direct", "virtual", "-1", "car",
)  # fmt: skip
RAW = (b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\x1b[2J", b"<", b'"', b",", b"\n", b"\xc3\x28", b"&#0;", b"]]>",
       b"<!--", b"<![CDATA[", b"<?x ?>", b"&lt;", b"[[", b"{", b"\\u0000", b"e")  # fmt: skip
