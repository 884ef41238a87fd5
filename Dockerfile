# The programs, in an image without a toolchain.
FROM rust:1.95-slim-bookworm AS build
WORKDIR /source
COPY . .
RUN cargo install --locked --path programs --root /built

FROM debian:bookworm-slim
COPY --from=build /built/bin/ /usr/local/bin/
CMD ["lgs-infer", "--help"]
