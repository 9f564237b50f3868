"""Plots, drawings, videos and pages."""
