"""What makes a learned reward one that PPO can climb? Encoders under one changed factor at a time, and their audits.

    python -m benchmarks.studies.reward encoders                 # trains and audits all variants, seeds 0-2
    python -m benchmarks.studies.reward policies default_0 ...   # trains policies on some of these encoders
    python -m benchmarks.studies.reward report                   # report.md and its figures

Both tables are written member by member, into this folder; what is there already is not done again.
"""
