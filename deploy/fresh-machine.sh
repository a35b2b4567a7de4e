#!/usr/bin/env bash
# README's two commands where nothing is installed: a bare Python container with only make and git added, first as
# root, then as a normal user for whom root has installed the system packages that the commands name.
#
# usage: deploy/fresh-machine.sh [root|user]...      (both, one after the other; a quarter of an hour each)
#
# The sources are a clone of HEAD. Environment, all optional:
#   BPN_WHEELS      folder with wheels that pip prefers (as for docker compose build)
#   TORCH_INDEX     where pip finds torch beside PyPI; empty: PyPI's, which brings CUDA
#   PYTHON_IMAGE    the bare machine
#   COMMANDS        "up test"; "up" alone tells how long and how many bytes it is to the first iteration (minutes)
set -euo pipefail
cd "$(dirname "$0")/.."
image=${PYTHON_IMAGE:-python:3.11-slim-bookworm}
wheels=$(realpath "${BPN_WHEELS:-deploy/compose/wheels}")
index=${TORCH_INDEX-https://download.pytorch.org/whl/cpu}
folder=$(mktemp -d)
container=bpn-fresh-machine-$$
trap 'docker rm -f "$container" >/dev/null 2>&1 || true; rm -rf "$folder"' EXIT

as() { # as USER COMMAND: in the clone, with pip told where wheels are
    docker exec --user "$1" --workdir /home/newcomer/bpn \
        --env PIP_FIND_LINKS=/wheels ${index:+--env "PIP_EXTRA_INDEX_URL=$index"} \
        "$container" bash -euc "$2"
}

# `make up` goes on until it is interrupted, so it is: once its first run has learned something.
up='
    before=$(awk "/eth0:/ {print \$2}" /proc/net/dev)
    make up >up.log 2>&1 &
    make=$!
    trap "cat up.log" ERR
    for second in $(seq 3000); do
        sleep 1
        if grep -q "bpn dashboard: http" up.log && test -s "$(echo runs/*/metrics.jsonl)"; then learned=yes; break; fi
        kill -0 $make
    done
    test "${learned-no}" = yes || { echo "make up: no run has learned anything after $second s"; false; }
    pkill -INT -P $make
    wait $make || true
    fetched=$(($(awk "/eth0:/ {print \$2}" /proc/net/dev) - before))
    echo "make up: an iteration was learned after $second s, everything included; $((fetched / 1000000)) MB came over the network"'

for who in "${@:-root user}"; do
    for account in $who; do
        echo "=== as $account, $image"
        docker rm -f "$container" >/dev/null 2>&1 || true
        docker run -d --init --shm-size=1g --name "$container" --volume "$wheels:/wheels:ro" "$image" \
            sleep infinity >/dev/null
        docker exec "$container" sh -euc 'apt-get update -qq && apt-get install -y -qq --no-install-recommends make git procps >/dev/null
            useradd --create-home newcomer'
        git clone -q --no-hardlinks . "$folder/bpn"
        tar -C "$folder" -c bpn | docker exec -i "$container" tar -C /home/newcomer -x
        rm -rf "$folder/bpn"
        user=root
        if [ "$account" = user ]; then
            user=newcomer
            docker exec "$container" chown -R newcomer: /home/newcomer
            # What is missing is told together with the command that installs it, which root then runs.
            for check in "" browser observability; do
                said=$(as newcomer "sh deploy/check-system.sh python3 $check 2>&1" || true)
                command=$(sed -n "s/^on Debian or Ubuntu: sudo sh -c '\(.*\)'$/\1/p" <<<"$said")
                echo "a normal user is told: ${command:-nothing is missing}"
                [ -z "$command" ] || docker exec --env DEBIAN_FRONTEND=noninteractive "$container" sh -euc "$command" >/dev/null
            done
        else
            docker exec "$container" chown -R root: /home/newcomer/bpn
        fi
        for command in ${COMMANDS:-up test}; do
            case $command in
                up) as "$user" "$up" ;;
                *) as "$user" "make $command" ;;
            esac
            echo "=== as $account: make $command passes"
        done
    done
done
