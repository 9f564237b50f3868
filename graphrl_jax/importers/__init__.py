"""Demonstrations from elsewhere: videos, folders of frames, MAGICAL's trajectories, ready-made boxes.

Sources (`magical`, `pictures`, `labels`) hand over recordings; `convert` sees, tracks and puts them together.
"""
