#!/usr/bin/env bash
# One data-centre GPU: everything that the repository measures there, part by part.
#
#     pip install -e ".[gpu]" && benchmarks/gpu.sh [PART ...]
#
#     train        a policy on Match Regions by one command: runs/gpu/match_regions
#     rewards      the released models' rewards, beside those on a CPU
#     throughput   physics and whole PPO of Match Regions
#     shoes        the same of Shoes in Box, with MJX and, if the package warp-lang is there, with MuJoCo Warp
#     pytorch      pretraining beside PyTorch; needs torch with CUDA
#     policy       a policy on Shoes in Box: runs/gpu/shoes_policies
#     alphas       five alphas with five seeds each, 25 policies side by side: runs/gpu/alphas
#
# All parts in this order if none is named; each has its own limit in seconds, and one that runs out of time does not
# stop the others. Result files: $RESULTS (default benchmarks/results), named *_gpu.json. While `train` runs, the other
# parts that are named compile their programs on the CPU cores that it leaves, so that all share one cache.
# Smaller, to try it: RESULTS=runs/gpu SIZES=2 STEPS=2 REPEATS=1 PRESET=smoke benchmarks/gpu.sh train throughput
set -uo pipefail
cd "$(dirname "$0")/.."

python=${PYTHON:-python}
results=${RESULTS:-benchmarks/results}
runs=${RUNS:-runs/gpu}
preset=${PRESET:-gpu}
sizes=${SIZES:-1024 4096 16384}
steps=${STEPS:-16} # decisions per call; a quarter of it on Shoes in Box, which decides every fourth control step
repeats=${REPEATS:-5}
engines=mjx
if "$python" -c 'import sys, importlib.util as found; sys.exit(found.find_spec("warp") is None)'; then
    engines="mjx warp"
fi
# Processes that compile side by side must not take the whole memory each.
export XLA_PYTHON_CLIENT_PREALLOCATE=false

within() { # seconds, command
    timeout --signal=INT --kill-after=10 "$@" || echo "stopped or failed ($?): ${*:2}" >&2
}

# Lists of sizes and engines are unquoted on purpose.
# shellcheck disable=SC2086
measure() { # task, engines, sizes, repeats, result file
    local decisions=$steps
    if [ "$1" = shoes_in_box ]; then decisions=$(((steps + 3) / 4)); fi
    within 170 "$python" -m benchmarks.throughput --task "$1" --engines $2 --programs ppo_env ppo_graph --num-envs $3 \
        --steps "$decisions" --repeats "$4" --out "$5"
}

compile() { # task, engines: compiles the programs of every size by itself
    local size
    for size in $sizes; do
        measure "$1" "$2" "$size" 1 "$runs/compiled/$1_$size.json" > /dev/null 2>&1 &
    done
}

demos() { # task
    [ -e "$runs/$1.npz" ] || within 120 "$python" -m graphrl_jax demos --task "$1" --num 16 --out "$runs/$1.npz"
}

all="train rewards throughput shoes pytorch policy alphas"
parts=${*:-$all}
for part in $parts; do
    case " $all " in *" $part "*) ;; *) echo "unknown part '$part'; allowed: $all" >&2; exit 2 ;; esac
done
mkdir -p "$runs/compiled" "$results"
for part in $parts; do
    if [ "$part" = train ]; then
        case " $parts " in *" throughput "*) compile match_regions mjx ;; esac
        case " $parts " in *" shoes "*) compile shoes_in_box "$engines" ;; esac
    fi
    case $part in
    train) within 240 "$python" train.py --preset "$preset" ${UPDATES:+--updates "$UPDATES"} --out "$runs/match_regions"; wait ;;
    rewards)
        for task in match_regions shoes_in_box; do
            demos $task
            within 60 "$python" -m benchmarks.devices --model "checkpoints/${task}_graph" --demos "$runs/$task.npz" \
                --out "$results/devices_${task}_gpu.json"
        done ;;
    throughput) measure match_regions mjx "$sizes" "$repeats" "$results/throughput_gpu.json" ;;
    shoes) measure shoes_in_box "$engines" "$sizes" "$repeats" "$results/throughput_shoes_in_box_gpu.json" ;;
    pytorch) within 90 "$python" -m benchmarks.pytorch ;;
    policy)
        within 540 "$python" -m benchmarks.shoes_policies --preset "$preset" --methods graph --seeds 0 \
            --engines mjx --runs "$runs/shoes_policies" ;;
    alphas)
        within 400 "$python" -m graphrl_jax sweep --preset "$preset" --alphas 1,2,4,8,16 --seeds 5 --first-seed 40 \
            --out "$runs/alphas" ;;
    esac
done
