#!/usr/bin/env bash
# Run a small study on this machine alone, and on a real Slurm of two nodes, one of which dies in the middle; compare the results.
#   pip install snakemake-executor-plugin-slurm
#   benchmarks/slurm/trial.sh DIR        # in the environment that sb3-guide is installed in
set -euo pipefail

here=$(cd "$(dirname "$0")" && pwd)
dir=$(mkdir -p "${1:?usage: trial.sh DIR}" && cd "$1" && pwd)
workflow=$(python -c "from sb3_guide.experiments.workflow.running import SNAKEFILE; print(SNAKEFILE)")
profile=$here/../../docs/cluster

echo "== on this machine"
sb3-guide reproduce --study trial --conditions "$here/trial.yml" --cores 2 --out "$dir/local"

echo "== on Slurm"
"$here/start.sh" "$dir/slurm"
trap '"$here/stop.sh"' EXIT
export OMP_NUM_THREADS=1
snakemake all --snakefile "$workflow" --directory "$dir/cluster" --profile "$profile" \
  --config study=trial conditions="$here/trial.yml" > "$dir/snakemake.log" 2>&1 &
snakemake=$!

victim=$dir/cluster/GoToObj/seed0/guide-brief/checkpoint/cloning.pt
until [ -e "$victim" ]; do
  kill -0 $snakemake || { tail "$dir/snakemake.log"; exit 1; }
  sleep 0.2
done
job=$(squeue -h -t R -o '%i %N' | head -1)
node=${job#* }
echo "job ${job% *} is at work on $node: that node dies"
pkill -9 -f "slurmd -N $node" || true
pids=$(pgrep -f "slurmstepd: \[${job% *}\." || true)
for pid in $pids; do
  pkill -9 -P "$pid" || true
  kill -9 "$pid" || true
done
pkill -9 -f "clone .*GoToObj/seed0/guide-brief " || true
sleep 40 # Slurm takes a node for dead after SlurmdTimeout
scontrol show job "${job% *}" | grep -o 'Restarts=[0-9]*' || true
slurmd -N "$node"
wait $snakemake

echo "== the same?"
cd "$dir/local"
for weights in GoToObj/seed*/*/network.safetensors; do
  cmp "$weights" "$dir/cluster/$weights" && echo "$weights: equal"
done
grep -h -o 'Restarts=[0-9]*' "$dir"/slurm/log/*.log | sort | uniq -c || true
