"""What a run's folder says about the run: facts, headline numbers, and what was missed."""
