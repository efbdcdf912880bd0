# The console as a container: `docker run -p 8000:8000 dronerf` flies four simulated drones around
# the robot dog; the log prints the address with its token. Real drones need `--network host` and
# `dronerf serve --fleet FILE`.
#
# It builds on plain Debian on purpose: every step can be repeated in a bare root of that release.
FROM debian:bookworm-slim

# libx11-6 is the one library that the simulator's renderer needs from the system.
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
       python3 python3-venv make ca-certificates libx11-6 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /srv/dronerf
# Where pip looks for torch; PyTorch's installation page gives the address of the small CPU build.
ARG TORCH_INDEX=""
COPY Makefile pyproject.toml constraints.txt README.md LICENSE ./
COPY server server
COPY web web
RUN make setup TORCH_INDEX="${TORCH_INDEX}" && rm -rf web/node_modules /root/.cache

RUN useradd --create-home --uid 1000 dronerf && mkdir runs && chown dronerf runs
USER dronerf
ENV PATH=/srv/dronerf/.venv/bin:$PATH \
    DRONERF_HOST=0.0.0.0 \
    DRONERF_MAKE_TOKEN=true \
    DRONERF_RUNS=/srv/dronerf/runs \
    NUMBA_CACHE_DIR=/tmp/numba \
    PYTHONUNBUFFERED=1
VOLUME /srv/dronerf/runs
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=3s --start-period=60s \
    CMD ["python3", "-c", "import urllib.request as u; u.urlopen('http://127.0.0.1:8000/livez', timeout=2)"]
ENTRYPOINT ["dronerf"]
CMD ["serve", "--sim", "robot_dog"]
