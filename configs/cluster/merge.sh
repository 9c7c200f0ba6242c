#!/bin/sh
#SBATCH --job-name=manylight-merge
#SBATCH --output=manylight-merge-%j.log
# Puts the parts that part.sh left together into OUT/whole.exr and OUT/whole.png: merge.sh OUT
#
# Says which part is missing, if one is: give it to part.sh again, alone.
set -eu
exec manylight merge "$1"/part*.exr --out "$1/whole.exr"
