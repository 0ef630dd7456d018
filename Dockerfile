# The command `resim` without anything else; results are written into the folder that is mounted at /work:
#   docker build -t resim .
#   docker run --rm -v "$PWD:/work" resim run scenarios/cut_in_brake --build adfunc/builds/highway_pilot-1.0.toml --out out/run
FROM python:3.12-slim

# what SUMO's binaries need
RUN apt-get update \
    && apt-get install -y --no-install-recommends libx11-6 libxext6 libxrender1 libgl1 libatomic1 libexpat1 \
    && rm -rf /var/lib/apt/lists/*

COPY . /usr/src/resim
RUN pip install --no-cache-dir --constraint /usr/src/resim/constraints.txt /usr/src/resim

RUN useradd --create-home resim && mkdir /work && chown resim /work
USER resim
WORKDIR /work
ENTRYPOINT ["resim"]
CMD ["--help"]
