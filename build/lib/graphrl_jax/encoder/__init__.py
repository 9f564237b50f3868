"""The encoder phi: maps one graph or one image to one embedding (Eq. 1-2)."""
