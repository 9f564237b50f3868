"""Perception: detection of objects in images, tracking over time, and import of recordings as demonstrations."""
