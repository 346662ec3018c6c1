# An image with the command twin; `docker run --rm -v "$PWD:/work" twin run sils` writes /work/twin-out/.
# With --target demo, `make demo` runs in the checkout: docker build --target demo -t twin-demo . && docker run --rm twin-demo
FROM python:3.12-slim-bookworm AS demo
RUN apt-get update && apt-get install --no-install-recommends -y make git libgl1 && rm -rf /var/lib/apt/lists/*
COPY . /twin
WORKDIR /twin
RUN make .venv/.synced
CMD ["make", "demo"]

FROM python:3.12-slim-bookworm AS built
RUN apt-get update && apt-get install --no-install-recommends -y binutils && rm -rf /var/lib/apt/lists/*
COPY . /twin
RUN python -m venv /opt/twin && /opt/twin/bin/pip install --no-cache-dir --no-compile /twin && \
    python /twin/docs/packaging/trim.py /opt/twin

FROM python:3.12-slim-bookworm
COPY --from=built /opt/twin /opt/twin
ENV PATH=/opt/twin/bin:$PATH
WORKDIR /work
EXPOSE 8080 8765
ENTRYPOINT ["twin"]
