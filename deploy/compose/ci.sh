#!/usr/bin/env bash
# The containers' part of continuous integration: really run them if a Docker engine answers, else say loudly
# that they were not run, and check at least that compose accepts the files.
set -euo pipefail
cd "$(dirname "$0")/../.."

if timeout 20 docker info >/dev/null 2>&1; then
    exec make test-containers
fi
if timeout 20 docker compose version >/dev/null 2>&1; then
    docker compose config --quiet
    docker compose -f compose.yaml -f deploy/compose/official-router.yaml config --quiet
    BPN_SERVER_NAMES=example docker compose -f compose.yaml -f deploy/compose/other-machines.yaml config --quiet
    docker compose --project-directory . -f deploy/compose/machine.yaml config --quiet
    checked="compose accepts the files, but"
fi
cat >&2 <<END

  ###########################################################################
  #  NO DOCKER ENGINE: THE CONTAINERS WERE NOT BUILT AND NOT RUN            #
  ###########################################################################
  ${checked-not even the compose files were checked (no docker compose), and} nobody has seen the containers work.

END
