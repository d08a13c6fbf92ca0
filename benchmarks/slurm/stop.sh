#!/usr/bin/env bash
# Stop what start.sh started.
set -euo pipefail
scontrol shutdown 2> /dev/null || true
pkill -x slurmd || true
pkill -x munged || true
