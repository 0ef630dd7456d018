"""Parts of perception: what happens to the EGO's state and to lists of objects after those were made."""
