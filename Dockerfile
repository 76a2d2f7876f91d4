# collabslam in a container, for amd64 and arm64: docker buildx build --platform linux/amd64,linux/arm64 -t collabslam .
# docker run --rm -v $PWD:/data collabslam run /data/walk --out /data/results/walk
FROM rust:1.89-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends python3-pip python3-venv
RUN python3 -m venv /build && /build/bin/pip install --no-cache-dir 'maturin>=1.9,<2'
WORKDIR /source
COPY . .
RUN PATH=/build/bin:$PATH maturin build --release --locked --compatibility linux --out /dist

FROM python:3.12-slim-bookworm
COPY --from=build /dist /dist
RUN wheel=$(ls /dist/*.whl) && pip install --no-cache-dir "${wheel}[live,plot,ros]" && rm -r /dist
WORKDIR /data
ENTRYPOINT ["collabslam"]
CMD ["--help"]
