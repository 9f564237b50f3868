"""The learned reward, a distance to the goal in the embedding space (Eq. 3), and its evaluation."""
