# Two commands: `make repro` runs the whole pipeline, `make test` runs the tests; `make test-all`
# adds those that want a browser, a video estimator or a cluster, or repeat a law in large.
# `make video` sets up the pose estimator of `s3le video`, `make videos` fetches videos to try.
# `make report` runs as much of the pipeline as the page that reads a run needs.
# `make paper` runs the pipeline by what is printed in the paper.
# `make study` repeats the trainings behind reports/study, `make search` searches settings for each
# method on a validation set, `make judge` makes the independent judgement behind reports/judge.
# `make hpp` fetches a third judge for it, which proves paths. `make rivals` runs what else there is
# on the same motions and has it judged.
# All set up .venv by themselves; PIP_ARGS is passed to every pip call.
PYTHON ?= python3
PIP_ARGS ?=
VENV := .venv
READY := $(VENV)/ready
RUN := PATH="$(CURDIR)/$(VENV)/bin:$$PATH" PIP_ARGS="$(PIP_ARGS)" PIP_DISABLE_PIP_VERSION_CHECK=1

.PHONY: repro report test laws test-all paper study search judge hpp rivals video videos setup lint lock

repro: setup
	@$(RUN) dvc repro

report: setup
	@$(RUN) dvc repro report

# Every law once: readers against a hundred broken files each, the proof, the guard, one whole tiny
# run of the pipeline, and a disaster for each way of writing. No browser, estimator or cluster.
TESTS := OMP_NUM_THREADS=1 pytest -q -n auto --dist loadfile --no-loadscope-reorder
test: setup
	@$(MAKE) --no-print-directory -j 2 lint laws
laws: setup
	@$(RUN) $(TESTS) -m "not wide"

# All of these and the `wide` ones: what wants a browser, a video estimator or a cluster, a third
# judge, the tour, and what repeats in large: experiments through all stages, another robot through
# dvc, more kills. Whoever lacks a browser or the others has the tests that want them skipped.
test-all: lint
	-@$(MAKE) --no-print-directory video
	-@$(MAKE) --no-print-directory hpp
	-@$(RUN) python benchmarks/videos.py sports2d
	@$(RUN) $(TESTS)

# The pipeline by what is printed in the paper (profiles/paper.yaml). ARGS="-S clips=cmu"
paper: setup
	@$(RUN) python benchmarks/study/by_profile.py paper $(ARGS)

# Resumable; without a GPU it takes hours and goes on in the background.
# ARGS="--only cmu --set clips_mirror=/a/mirror/of/cmu"
study: setup
	@$(RUN) python benchmarks/study/run.py $(ARGS)

# The same settings' budget for each method, on a validation set; resumable, in the background.
search: setup
	@$(RUN) python benchmarks/study/search.py $(ARGS)

# Resumable; a million steps take hours. ARGS="--help" says what can be chosen.
judge: setup
	-@$(MAKE) --no-print-directory hpp
	@$(RUN) OMP_NUM_THREADS=1 python benchmarks/judge/run.py $(ARGS)

# HPP proves paths by other code; where there is no wheel of it, coal and MuJoCo judge alone.
hpp: $(VENV)/hpp

$(VENV)/hpp: requirements-judge.lock $(READY)
	@$(RUN) $(VENV)/bin/python -m pip install -q $(PIP_ARGS) --no-deps -r requirements-judge.lock
	@touch $@

# Every retargeter that runs here, on the same motions, judged between the frames: half an hour,
# resumable. ARGS="--quick" looks for four minutes, ARGS="--all" does the rest.
rivals: setup
	-@$(RUN) python benchmarks/rivals/install.py
	@$(RUN) OMP_NUM_THREADS=1 python benchmarks/rivals/run.py $(ARGS)

# MediaPipe 0.10.21 has wheels for Python 3.9 to 3.12 and wants an older numpy than s3le: it gets
# an environment of its own. VIDEO_PYTHON=/path/to/python3.12 names the interpreter.
VIDEO_VENV := .venv-video
VIDEO_PYTHON ?=
FITS := import sys; sys.exit(not (3, 9) <= sys.version_info[:2] <= (3, 12))

video: $(VIDEO_VENV)/ready

$(VIDEO_VENV)/ready: requirements-video.lock
	@for python in $(or $(VIDEO_PYTHON),python3.12 python3.11 python3.10 python3.9 $(PYTHON)); do \
	  if $$python -c '$(FITS)' 2>/dev/null; then found=$$python; break; fi; done; \
	if test -z "$$found"; then \
	  echo "make: MediaPipe 0.10.21 needs Python 3.9, 3.10, 3.11 or 3.12, and none is here;" \
	    "install one, then: make video VIDEO_PYTHON=/path/to/python3.12" >&2; exit 1; fi; \
	echo "setting up $(VIDEO_VENV) with $$found"; \
	rm -rf $(VIDEO_VENV) && $$found -m venv $(VIDEO_VENV)
	@$(RUN) $(VIDEO_VENV)/bin/python -m pip install -q $(PIP_ARGS) --no-deps -r requirements-video.lock
	@touch $@

videos: setup
	@$(RUN) python benchmarks/videos.py

setup: $(READY)

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "make: $(PYTHON) is older than Python 3.11; name another: make PYTHON=python3.12" >&2; exit 1; }
	@test -x $(VENV)/bin/python || $(PYTHON) -m venv $(VENV)
	@echo "setting up $(VENV): PyTorch, then the locked packages"
	@$(RUN) $(VENV)/bin/python -m pip install -q $(PIP_ARGS) torch==2.13.0
	@$(RUN) $(VENV)/bin/python -m pip install -q $(PIP_ARGS) -r requirements.lock
	@$(RUN) $(VENV)/bin/python -m pip install -q $(PIP_ARGS) --no-deps -e .
	@touch $@

lint: setup
	@$(RUN) ruff check .
	@$(RUN) ruff format --check -q .
	@$(RUN) mypy

# Needs uv; CUDA packages stay out, so that the lock serves machines with and without a GPU.
lock:
	uv pip compile pyproject.toml --extra pipeline --extra dev --extra cluster --extra view --universal --python-version 3.11 \
	  --no-header --no-annotate --no-emit-package torch -q -o requirements.new
	{ sed -n '/^#/p' requirements.lock; grep -vE '^(nvidia-|triton|cuda-)' requirements.new; } \
	  > requirements.tmp && mv requirements.tmp requirements.lock && rm requirements.new
