# gsedit on a CPU, as a user without rights. Scenes are mounted at /data:
#   docker build -t gsedit . && docker run --rm -v "$PWD:/data" gsedit edit scene.ply "make it snow" -o snow
FROM python:3.11-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends g++
COPY . /source
RUN GSEDIT_KERNELS=-s pip wheel --no-deps -w /wheels /source

FROM python:3.11-slim
COPY constraints.txt /tmp/
# the wheel is mounted, so that no layer keeps it; torch's headers and tests are for those who build it
RUN --mount=from=build,source=/wheels,target=/wheels \
    pip install --no-cache-dir -c /tmp/constraints.txt \
        --extra-index-url https://download.pytorch.org/whl/cpu /wheels/*.whl \
    && rm -rf /usr/local/lib/python3.11/site-packages/torch/include \
        /usr/local/lib/python3.11/site-packages/torch/test \
    && useradd --create-home gsedit && install -d -o gsedit /data
USER gsedit
WORKDIR /data
ENTRYPOINT ["gsedit"]
