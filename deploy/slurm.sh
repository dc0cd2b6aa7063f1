#!/bin/bash
# One evaluation on several nodes of a SLURM cluster:
#
#   sbatch --nodes=4 deploy/slurm.sh --data DATA --model MODEL --out RUN --world kinova
#
# The arguments are those of `cutgrammar evaluate`; their folders lie on a file system that all nodes see. SLURM sends
# TERM two minutes before the time is over, and the evaluation stops; the same sbatch command resumes it.
#SBATCH --job-name=cutgrammar
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=16
#SBATCH --mem-per-cpu=2G
#SBATCH --time=24:00:00
#SBATCH --signal=B:TERM@120
set -euo pipefail

# Replace this by what puts `cutgrammar` and `ray` on the PATH of every node.
source "${CUTGRAMMAR_ENV:-$HOME/cutgrammar/.venv}/bin/activate"

head=$(hostname)
port=$((20000 + SLURM_JOB_ID % 10000)) # two jobs on one node do not meet
export RAY_AUTH_MODE=token
RAY_AUTH_TOKEN=$(python -c 'import secrets; print(secrets.token_hex(32))')
export RAY_AUTH_TOKEN

# A Ray for each node, of a folder of its own; every one ends with the job.
start_ray() { # where, how many, then the options of ray start
  local where=$1 count=$2
  shift 2
  srun $where --nodes="$count" --ntasks="$count" --overlap --export=ALL \
    ray start --block --disable-usage-stats --num-cpus="$SLURM_CPUS_PER_TASK" --temp-dir="/tmp/ray-$SLURM_JOB_ID" "$@" &
}
start_ray "--nodelist=$head" 1 --head --port="$port" --include-dashboard=false
for _ in $(seq 60); do
  ray status --address="$head:$port" >/dev/null 2>&1 && break
  sleep 1
done
if [ "$SLURM_JOB_NUM_NODES" -gt 1 ]; then
  start_ray "--exclude=$head" $((SLURM_JOB_NUM_NODES - 1)) --address="$head:$port"
fi

workers=$((SLURM_JOB_NUM_NODES * SLURM_CPUS_PER_TASK)) # workers of nodes that are still starting wait for them
cutgrammar evaluate --address "$head:$port" --workers "$workers" "$@" &
driver=$!
trap 'kill -TERM $driver' TERM
code=0
wait $driver || code=$?
if kill -0 $driver 2>/dev/null; then # the signal ended the first wait
  code=0
  wait $driver || code=$?
fi
kill $(jobs -p) 2>/dev/null || true
exit $code
