#!/bin/sh
# Renders a picture in parts on a Slurm cluster and merges them: submit.sh RUN.ron PARTS OUT [flags of render]
#
# Flags for sbatch (--cpus-per-task, --partition, --time) go into SBATCH_FLAGS. OUT is on a disk that all nodes share.
set -eu
here=$(dirname "$0")
parts=$2 out=$3
# Where the queue is, words are to be divided at blanks.
# shellcheck disable=SC2086
array=$(sbatch ${SBATCH_FLAGS:-} --parsable --array="1-$parts" "$here/part.sh" "$@")
# Not `afterok`: the merge is what names the parts that failed.
merge=$(sbatch --parsable --dependency="afterany:$array" "$here/merge.sh" "$out")
echo "parts: job $array, then merge: job $merge"
