"""Reads XML of strangers: no entity is resolved, nothing is fetched, a DOCTYPE is refused."""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from resim.core.errors import InputError


def safe_root(text: bytes, path: Path, *, remedy: str) -> etree._Element:
    """Give the root element of the text; `path` and `remedy` are for its errors.

    Raises InputError where it is not well-formed or has a DOCTYPE, which may declare entities.
    """
    declares = InputError(path, "has a DOCTYPE, which may declare entities", "Remove the DOCTYPE")
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise declares
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, huge_tree=False,
        remove_comments=True, remove_pis=True,
    )  # fmt: skip
    try:
        root = etree.fromstring(text, parser)
    except etree.XMLSyntaxError as error:
        raise InputError(path, f"is not well-formed XML ({' '.join(error.msg.split())})", remedy) from None
    if root.getroottree().docinfo.internalDTD is not None:  # in an encoding that hid it from the search
        raise declares
    return root
