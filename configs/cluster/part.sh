#!/bin/sh
#SBATCH --job-name=manylight
#SBATCH --output=manylight-%A_%a.log
#SBATCH --requeue
# Renders one part of a picture: part.sh RUN.ron PARTS OUT [flags of render]
#
# Which part, the scheduler says: a Slurm array (--array=1-PARTS) or a Kubernetes indexed job (from 0). A part that is
# started again goes on where it was.
set -eu
run=$1 parts=$2 out=$3
shift 3
part=${SLURM_ARRAY_TASK_ID:-$((${JOB_COMPLETION_INDEX:?neither this nor SLURM_ARRAY_TASK_ID is set} + 1))}
if [ -n "${SLURM_CPUS_PER_TASK:-}" ]; then
    set -- --threads "$SLURM_CPUS_PER_TASK" "$@"
fi
exec manylight render "$run" --shard "$part/$parts" --name "part$part" --out "$out" --resume "$@"
