#!/bin/sh
# What a GPU makes of the learner: its gradients and its learning against the CPU's, then updates per second operator by
# operator, as captured graphs, and of Stable-Baselines3 on the same card. Under five minutes.
# usage: bench/gpu.sh [PYTHON], with bpn-learner, bpn[bench] and a torch for CUDA installed
set -eu
cd "$(dirname "$0")/.."
python=${1:-.venv/bin/python}
if ! "$python" -c 'import sys, torch; sys.exit(not torch.cuda.is_available())'; then
  printf '%s\n' '' '*** SKIPPED: torch finds no GPU here, so nothing was checked or measured. ***' '' >&2
  exit 0
fi
exec timeout 300 "$python" bench/gpu.py
