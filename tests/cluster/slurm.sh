#!/bin/sh
# Checks configs/cluster on a Slurm cluster: a render in parts has the bits of a whole one, and a part that was lost is
# named by the merge and rendered again alone. Run in the repository's folder; `manylight` and `sbatch` are on the path,
# and all nodes share the folder OUT (default: out/slurm). No part of `cargo test`.
set -eu
out=${1:-out/slurm}
flags="--size 240x135 --spp 8 --set lights.count=20000"
rm -rf "$out"
mkdir -p "$out"

finished() {
    while squeue --noheader --me | grep -q .; do sleep 1; done
}

# shellcheck disable=SC2086
manylight render configs/nave.ron $flags --out "$out" --name alone --quiet
# shellcheck disable=SC2086
sh configs/cluster/submit.sh configs/nave.ron 4 "$out/parts" $flags
finished
cmp "$out/alone.exr" "$out/parts/whole.exr"
echo "4 parts: the bits of one machine"

rm "$out/parts/part3.exr" "$out/parts/whole.exr"
if sh configs/cluster/merge.sh "$out/parts" 2> "$out/said"; then
    echo "a missing part was not noticed" >&2
    exit 1
fi
cat "$out/said"
grep -q "3/4" "$out/said"
# shellcheck disable=SC2086
sbatch --wait --array=3 configs/cluster/part.sh configs/nave.ron 4 "$out/parts" $flags
sbatch --wait configs/cluster/merge.sh "$out/parts"
cmp "$out/alone.exr" "$out/parts/whole.exr"
echo "the lost part, rendered alone: the bits of one machine"
