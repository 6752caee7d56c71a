#!/bin/sh
# Makes the certificates of a cluster: an authority of its own, and one certificate each for the scheduler, the workers
# and the callers. Each of the three keys permits running programs on every machine of the cluster.
#
#   deploy/cluster/certificates.sh FOLDER [DAYS]      [825 days]
#
# What is there already stays; delete a .pem to renew it, after ca.pem all of them. Keep ca.key off the cluster: it is
# needed here only.
set -eu
umask 077

folder="${1:?expected FOLDER}"
days="${2:-825}"
curve="ec_paramgen_curve:prime256v1"

fail() {
    echo "certificates.sh: $1" >&2
    exit 1
}

# What openssl says matters only where it fails.
quietly() {
    said=$(openssl "$@" 2>&1) || fail "openssl $1: $said"
}

case "$days" in
'' | *[!0-9]* | 0*) fail "DAYS: expected a whole number from 1, got '$days'" ;;
esac
command -v openssl >/dev/null || fail "expected openssl among the programs of this machine"
mkdir -p -- "$folder"
CDPATH='' cd -- "$folder"

if [ ! -e ca.pem ]; then
    quietly req -x509 -newkey ec -pkeyopt "$curve" -nodes -keyout ca.key -out ca.new -days "$days" \
        -subj "/CN=spallwatch cluster" -addext "keyUsage=critical,keyCertSign,cRLSign"
    mv ca.new ca.pem
fi
for role in scheduler worker client; do
    if [ ! -e "$role.pem" ]; then
        [ -e ca.key ] || fail "$folder: ca.key is missing, which makes $role.pem; bring it here for the moment"
        quietly req -newkey ec -pkeyopt "$curve" -nodes -keyout "$role.key" -out "$role.csr" -subj "/CN=spallwatch $role"
        printf 'keyUsage=critical,digitalSignature\nextendedKeyUsage=serverAuth,clientAuth\n' >"$role.ext"
        quietly x509 -req -in "$role.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -days "$days" -extfile "$role.ext" \
            -out "$role.new"
        mv "$role.new" "$role.pem"
        rm "$role.csr" "$role.ext"
    fi
    openssl verify -CAfile ca.pem "$role.pem" >/dev/null 2>&1 ||
        fail "$folder: $role.pem is not of this ca.pem, or has expired; delete it to renew it"
    [ -r "$role.key" ] || fail "$folder: $role.key is missing; delete $role.pem to renew both"
done
rm -f ca.srl
chmod 644 ca.pem
