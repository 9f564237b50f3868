#!/usr/bin/env bash
# One data-centre GPU, under nine minutes: throughput of both tasks, then a small Table I.
#
#     pip install -e ".[gpu]" && benchmarks/gpu.sh
#
# Every part has its own limit in seconds; what one has written stays, and a second call goes on with Table I where the
# first was stopped. Results: $RESULTS/{throughput,throughput_shoes_in_box}_gpu.{json,png} and
# benchmarks/results/table1_gpu.{json,png}; Table I's runs: $RUNS/table1_$PRESET.
# Shoes in Box is measured with MJX and, if the package warp-lang is there, with MuJoCo Warp: physics and whole PPO only,
# because compiling takes most of the time.
# Smaller, to try it: RESULTS=runs/gpu SIZES=2 SHOES_SIZES=2 STEPS=2 PRESET=smoke METHODS=env benchmarks/gpu.sh
set -uo pipefail
cd "$(dirname "$0")/.."

python=${PYTHON:-python}
results=${RESULTS:-benchmarks/results}
runs=${RUNS:-runs}
steps=${STEPS:-16}
engines=mjx
if "$python" -c 'import sys, importlib.util as found; sys.exit(found.find_spec("warp") is None)'; then
    engines="mjx warp"
fi

within() { # seconds, command: a part that runs out of time does not stop the others
    timeout --signal=INT --kill-after=10 "$@" || echo "stopped or failed ($?): ${*:2}" >&2
}

# Unquoted on purpose: lists of sizes, engines and methods.
# shellcheck disable=SC2086
{
    within 170 "$python" -m benchmarks.throughput --num-envs ${SIZES:-1024 4096 16384} --steps "$steps" --repeats 5 \
        --out "$results/throughput_gpu.json"
    within 130 "$python" -m benchmarks.throughput --task shoes_in_box --engines $engines \
        --programs ppo_graph --num-envs ${SHOES_SIZES:-1024 4096} --steps "$steps" --repeats 3 \
        --out "$results/throughput_shoes_in_box_gpu.json"
    within 230 "$python" -m benchmarks.table1 --preset "${PRESET:-gpu}" --updates "${UPDATES:-100}" --seeds 30 \
        --methods ${METHODS:-graph env graphirl} --budget-minutes 1.5 --out "$runs/table1_${PRESET:-gpu}"
}
