# specklegen with the build of PyTorch that the argument TORCH names; PIP_EXTRA_INDEX_URL says where pip looks for it, too.
#     docker build -t specklegen .
#     mkdir -p data
#     docker run --rm --user "$(id -u):$(id -g)" -v "$PWD/data:/data" specklegen \
#         generate through-slab --samples 4096 --out /data/through-slab.zarr
FROM python:3.12-slim
ARG TORCH="torch==2.13.0"
ARG PIP_EXTRA_INDEX_URL
RUN pip install --no-cache-dir "$TORCH"
COPY . /source
RUN pip install --no-cache-dir "/source[torch,mie,digits,photographs]" && rm -rf /source
ENV SPECKLEGEN_CACHE=/var/cache/specklegen MPLCONFIGDIR=/tmp
# Kernels compile once, into the image: whoever runs it reads them, and only root writes there.
RUN specklegen plan through-slab --samples 8 && chmod -R a+rX "$SPECKLEGEN_CACHE"
RUN useradd --create-home user
USER user
WORKDIR /data
ENTRYPOINT ["specklegen"]
