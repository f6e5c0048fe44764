# Runs a private Postgres server as an ordinary user until standard input ends; then it stops and removes its files.
# Usage: cluster.sh BIN PORT PASSWORD CERTIFICATE KEY
set -eu
bin=$1 port=$2 password=$3 certificate=$4 key=$5
umask 077
dir=$(mktemp -d)
server=
stop() {
    [ -z "$server" ] || { kill -CONT "$server" && kill -INT "$server" && wait "$server" || :; } 2>/dev/null
    rm -rf "$dir"
}
trap stop EXIT
printf %s "$password" >"$dir/password"
printf %s "$certificate" >"$dir/cert.pem"
printf %s "$key" >"$dir/key.pem"
# A collation that does not sort by bytes, as a hospital's server may have.
"$bin/initdb" -D "$dir/data" -U prosopon -A scram-sha-256 --pwfile="$dir/password" -E UTF8 --locale=C.UTF-8 \
    --locale-provider=icu --icu-locale=en-US --no-sync >"$dir/log" 2>&1 || { cat "$dir/log" >&2; exit 1; }
while :; do
    "$bin/postgres" -D "$dir/data" -k "$dir" -h 127.0.0.1 -p "$port" -c fsync="${FSYNC:-off}" -c full_page_writes="${FSYNC:-off}" \
        -c max_connections=200 -c ssl=on -c ssl_cert_file="$dir/cert.pem" -c ssl_key_file="$dir/key.pem" >>"$dir/log" 2>&1 </dev/null &
    server=$!
    for _ in $(seq 300); do
        if "$bin/pg_isready" -q -h 127.0.0.1 -p "$port" -U prosopon; then echo ready; break; fi
        kill -0 "$server" 2>/dev/null || { cat "$dir/log" >&2; exit 1; }
        sleep 0.1
    done
    # Commands: `restart` stops the server and starts it on the same port; `halt` suspends it and `continue` resumes it.
    while read -r command || exit 0; do
        case $command in
        halt) kill -STOP "$server" $(cat "/proc/$server/task/$server/children") && echo ready ;;
        continue) kill -CONT "$server" $(cat "/proc/$server/task/$server/children") && echo ready ;;
        *) break ;;
        esac
    done
    kill -INT "$server" && wait "$server" || :
done
