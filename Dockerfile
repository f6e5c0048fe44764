# Built from the lock file; the image holds the one binary.
FROM rust:1-bookworm AS builder
# The build makes the viewer with npm.
COPY --from=node:20-bookworm-slim /usr/local/bin /usr/local/bin
COPY --from=node:20-bookworm-slim /usr/local/lib/node_modules /usr/local/lib/node_modules
WORKDIR /build
COPY . .
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    --mount=type=cache,target=/build/target \
    cargo build --profile dist --locked --bin prosopon \
    && cp target/dist/prosopon /usr/local/bin/prosopon

FROM debian:bookworm-slim
# The authorities that TLS to a bucket trusts.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates \
    && rm -rf /var/lib/apt/lists/*
RUN groupadd --gid 10001 prosopon \
    && useradd --uid 10001 --gid prosopon --home-dir /data --no-create-home --shell /usr/sbin/nologin prosopon \
    && install --directory --owner prosopon --group prosopon --mode 0700 /data
COPY --from=builder /usr/local/bin/prosopon /usr/local/bin/prosopon
COPY LICENSE-MIT LICENSE-APACHE /usr/share/doc/prosopon/
USER prosopon
WORKDIR /data
VOLUME /data
# Without authentication the service listens on loopback only, here that of the network namespace: run with the host's.
# See deploy/README.md.
HEALTHCHECK --interval=30s --timeout=5s --start-period=10s \
    CMD ["bash", "-c", "exec 3<>/dev/tcp/127.0.0.1/8080 && printf 'GET /livez HTTP/1.0\\r\\nHost: 127.0.0.1\\r\\n\\r\\n' >&3 && head -n 1 <&3 | grep -q ' 200 '"]
ENTRYPOINT ["prosopon"]
CMD ["serve", "--listen", "127.0.0.1:8080", "--data", "/data"]
