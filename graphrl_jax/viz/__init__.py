"""Plots, drawings and videos."""
