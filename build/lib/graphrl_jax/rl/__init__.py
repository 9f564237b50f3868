"""Reinforcement learning: reward wrappers, PPO, and rollouts of a policy."""
