#!/bin/sh
# SPDX-License-Identifier: LGPL-3.0-or-later
# Open every ParaView series of the given result folders in the installed ParaView and draw it.
#   tests/paraview/check.sh RESULTS_DIR...
# Exit code 0: fine; 1: a series cannot be used; 2: ParaView is missing or wrong usage.
set -u

for program in pvbatch xvfb-run; do
    if ! command -v "$program" >/dev/null 2>&1; then
        echo "check.sh: $program not found, install the Debian packages paraview and xvfb" >&2
        exit 2
    fi
done
if [ $# -eq 0 ]; then
    echo "usage: check.sh RESULTS_DIR..." >&2
    exit 2
fi

here=$(cd "$(dirname "$0")" && pwd)
log=$(mktemp) || exit 2
trap 'rm -f "$log"' EXIT

# ParaView brings its own Python and libraries: nothing of an active environment may leak in.
# It connects to the X server more than once; without -noreset the server restarts in between and
# now and then refuses the next connection.
env -u PYTHONPATH -u PYTHONHOME -u VIRTUAL_ENV -u LD_LIBRARY_PATH \
    xvfb-run -a -s "-screen 0 1280x1024x24 -noreset" pvbatch "$here/check.py" "$@" 2>"$log"
code=$?

if [ $code -eq 0 ] && grep -q "ERR|" "$log"; then
    echo "check.sh: ParaView reports: $(grep -m 1 "ERR|" "$log")" >&2
    exit 1
fi
if [ $code -ne 0 ]; then
    reason=$(grep -m 1 "^check.py: " "$log" || tail -n 1 "$log")
    echo "${reason:-check.sh: pvbatch ended with code $code}" >&2
    exit 1
fi
