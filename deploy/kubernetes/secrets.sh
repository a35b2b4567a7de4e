#!/usr/bin/env bash
# The certificates of a folder as the secrets that the pods mount:
#   bpn-certificates certificates --server-name router --server-name localhost
#   deploy/kubernetes/secrets.sh certificates | kubectl apply --server-side -f -
# Both lines again, from a timer, renew what is near its end. Nothing is restarted: pods get the new files within two minutes, and
# use them. The authority's key stays in the folder, which belongs on no machine of the cluster.
set -euo pipefail
folder=${1:?usage: $0 FOLDER}
for role in router dashboard learner edge robot_sim; do
    kubectl create secret generic "certificates-${role//_/-}" --namespace=bpn --type=kubernetes.io/tls \
        --from-file=ca.crt="$folder/$role/authority.pem" \
        --from-file=tls.crt="$folder/$role/certificate.pem" \
        --from-file=tls.key="$folder/$role/key.pem" \
        --dry-run=client --output=yaml
    echo ---
done
