"""Pretraining of an encoder on demonstrations by soft TCC plus reconstruction."""
