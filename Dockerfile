# specklegen with a CPU build of PyTorch; the build argument TORCH names another one.
#     docker build -t specklegen .
#     docker run --rm -v "$PWD/data:/data" specklegen generate through-slab --samples 4096 --out /data/through-slab.zarr
FROM python:3.12-slim
ARG TORCH="torch==2.13.0"
ARG PIP_EXTRA_INDEX_URL
RUN pip install --no-cache-dir "$TORCH"
COPY . /source
RUN pip install --no-cache-dir "/source[mie,digits]" && rm -rf /source
RUN useradd --create-home user
USER user
ENV SPECKLEGEN_CACHE=/home/user/.cache/specklegen
# Kernels compile once, into the image.
RUN specklegen plan through-slab --samples 8
WORKDIR /data
ENTRYPOINT ["specklegen"]
