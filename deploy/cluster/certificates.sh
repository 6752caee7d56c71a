#!/bin/sh
# Makes the certificates of a cluster: an authority of its own, and one certificate each for the scheduler, the workers
# and the callers. Each of the three keys permits running programs on every machine of the cluster.
#
#   deploy/cluster/certificates.sh FOLDER [DAYS]      [825 days]
#
# What is there already stays; delete a .pem to renew it. Keep ca.key off the cluster: it is needed here only.
set -eu
umask 077

folder="${1:?expected FOLDER}"
days="${2:-825}"
curve="ec_paramgen_curve:prime256v1"
mkdir -p "$folder"
cd "$folder"

if [ ! -e ca.pem ]; then
    openssl req -x509 -newkey ec -pkeyopt "$curve" -nodes -keyout ca.key -out ca.pem -days "$days" \
        -subj "/CN=spallwatch cluster" -addext "keyUsage=critical,keyCertSign,cRLSign" 2>/dev/null
fi
for role in scheduler worker client; do
    if [ -e "$role.pem" ]; then continue; fi
    openssl req -newkey ec -pkeyopt "$curve" -nodes -keyout "$role.key" -out "$role.csr" \
        -subj "/CN=spallwatch $role" 2>/dev/null
    printf 'keyUsage=critical,digitalSignature\nextendedKeyUsage=serverAuth,clientAuth\n' >"$role.ext"
    openssl x509 -req -in "$role.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -days "$days" \
        -extfile "$role.ext" -out "$role.pem" 2>/dev/null
    rm "$role.csr" "$role.ext"
done
rm -f ca.srl
chmod 644 ca.pem
