# The programs, in an image without a toolchain.
FROM rust:1.95-slim-bookworm AS build
WORKDIR /source
COPY . .
RUN cargo install --locked --path programs --root /built

FROM debian:bookworm-slim
# Through it a GPU that is handed in can be reached.
RUN apt-get update && apt-get install -y --no-install-recommends libvulkan1 && rm -rf /var/lib/apt/lists/*
COPY --from=build /built/bin/ /usr/local/bin/
CMD ["lgs-infer", "--help"]
