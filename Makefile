# `make demo` and `make test` do all the set-up on a machine with Python 3.11 to 3.13, make and git.
# `make weights` makes the networks again that ship, `make table` the table of all planners; both go on where they were stopped.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
RETRIEVE ?= $(BIN)/retrieve
WORKERS ?= $(shell getconf _NPROCESSORS_ONLN)
export OMP_NUM_THREADS ?= 1
# Else each of the some hundred processes that tests start would compile all of Python's modules anew.
unexport PYTHONDONTWRITEBYTECODE

# The recipe of the weights that ship. SCALE=0.01 takes a hundredth of the scenes, ends in minutes, and ships nothing.
SCALE ?= 1
ROBOTS ?= ur5e panda
PAPER_ROBOTS ?= ur5e
LABEL_SCENES_ur5e ?= 9400
LABEL_SCENES_panda ?= 7775
LABEL_SPECS ?= paper paper-any paper paper-any shelf hard hard-any
LABEL_OBJECTS ?= 2
PARTLY_SEEN ?= 0.5
LABEL_SEED_ur5e ?= 101
LABEL_SEED_panda ?= 102
EPOCHS ?= 10
PAPER_EPOCHS ?= 8
WIDTH ?= 96
TRAIN_SEED ?= 0
THREADS ?= 1
DEVICE ?= auto

# The table, of own policies, too: POLICIES='local examples/07_own_policy.py:side'. TABLE_SCENES=1000 gives tighter intervals. Times are truest with WORKERS=1.
TABLE_SEED ?= 20261122
TABLE_SCENES ?= 100
TABLE_SPECS ?= paper paper-any shelf hard hard-any lab-s lab-l
POLICIES ?= random local rrt osnet-only osnet-only-paper rpnet-only rpnet-only-paper neural-paper neural-greedy neural lookahead search
RULES ?= deep strict
SENSED_SPECS ?= paper paper-any
SENSED_POLICIES ?= random local neural

.PHONY: demo test docs bench covers ahead weights table clean

demo: $(VENV)/ready
	$(RETRIEVE) demo --out out

docs: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[docs]'
	$(BIN)/python -m mkdocs build --strict --quiet

test: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy --num-workers 2
	$(BIN)/python -m pytest -n 2 --dist loadfile

bench: $(VENV)/ready
	$(BIN)/python benchmarks/motion.py

# The sphere covers of the named robots that ship, so that nobody waits for them: make them again when a robot or the algorithm changes.
covers: $(VENV)/ready
	$(BIN)/python -m kinematics.robots.ship_covers

# The list of what is compiled ahead: make it again when an entry of the motion core gets other arguments, or a new one comes.
ahead: $(VENV)/ready
	$(BIN)/python -m planning.compiling.make_list

# Weights: labels of generated scenes, then training; out/weights-SCALE/ROBOT/ holds the labels and the models --------------------------

MADE := out/weights-$(SCALE)
SHIPPED := planning/learning/weights
MODELS := $(ROBOTS:%=$(MADE)/%/model) $(PAPER_ROBOTS:%=$(MADE)/%/model-paper)
scenes = $(shell awk 'BEGIN { n = int($(or $(LABEL_SCENES_$*),1000) * $(SCALE) + 0.5); print n < 8 ? 8 : n }')
train = $(RETRIEVE) train $(MADE)/$*/labels -o $(@D) --form $(1) --epochs $(2) --width $(WIDTH) --seed $(TRAIN_SEED) --threads $(THREADS) --device $(DEVICE) \
	$$(test -z "$$(ls -A $(@D)/checkpoint 2>/dev/null)" || echo --resume)
ship = mkdir -p $(SHIPPED)/$(2) && cp $(1)/config.json $(1)/*.safetensors $(SHIPPED)/$(2)/

weights: $(MODELS:%=%/config.json)
ifeq ($(SCALE),1)
	$(foreach robot,$(ROBOTS),$(call ship,$(MADE)/$(robot)/model,$(robot)) &&) true
	$(foreach robot,$(PAPER_ROBOTS),$(call ship,$(MADE)/$(robot)/model-paper,$(robot)-paper) &&) true
endif

.PRECIOUS: $(MADE)/%/labelled
$(MADE)/%/labelled: | $(VENV)/ready
	mkdir -p $(@D)
	$(RETRIEVE) label -n $(scenes) --seed $(or $(LABEL_SEED_$*),103) --robot $* $(LABEL_SPECS:%=--spec %) --objects $(LABEL_OBJECTS) \
		--partly-seen $(PARTLY_SEEN) --workers $(WORKERS) -o $(@D)/labels
	touch $@

$(MADE)/%/model/config.json: $(MADE)/%/labelled
	$(call train,objects,$(EPOCHS))

$(MADE)/%/model-paper/config.json: $(MADE)/%/labelled
	$(call train,paper,$(PAPER_EPOCHS))

# Table: scenes, plans of every policy under every rule, some after sensing, a report for each spec; what is up to date is not planned again

TABLE := out/table
PLANNED := $(TABLE)/$(TABLE_SEED)-$(TABLE_SCENES)
# A policy in a file's name: MODULE:FUNCTION without what make and folders mean something by.
coded = $(subst :,@,$(subst /,+,$(subst .,~,$(1))))
decoded = $(subst @,:,$(subst +,/,$(subst ~,.,$(1))))
SOURCES := $(wildcard $(filter %.py,$(subst :, ,$(POLICIES)))) $(shell find kinematics perception planning -name '*.py' -o -name '*.toml' -o -path '$(SHIPPED)/*' -type f)
SCENES := $(TABLE_SPECS:%=$(PLANNED)/%/scenes.jsonl)
PLANS := $(foreach spec,$(TABLE_SPECS),$(foreach rule,$(RULES),$(foreach p,$(POLICIES),$(PLANNED)/$(spec)/$(call coded,$(p)).$(rule).jsonl)))
SENSED := $(foreach spec,$(filter $(SENSED_SPECS),$(TABLE_SPECS)),$(foreach p,$(SENSED_POLICIES),$(PLANNED)/$(spec)/$(call coded,$(p)).sensed.jsonl))

table: $(PLANS) $(SENSED)
	for spec in $(TABLE_SPECS); do \
		$(RETRIEVE) report $$(ls $(PLANS) $(SENSED) | grep "/$$spec/") \
			--scenes $(PLANNED)/$$spec/scenes.jsonl -o $(TABLE)/$$spec.md -o $(TABLE)/$$spec.html -o $(TABLE)/$$spec.csv || exit 1; \
	done
	for spec in $(TABLE_SPECS); do echo; echo "Spec $$spec"; echo; cat $(TABLE)/$$spec.md; done

$(SCENES): $(PLANNED)/%/scenes.jsonl: $(SOURCES) | $(VENV)/ready
	mkdir -p $(@D)
	$(RETRIEVE) gen -n $(TABLE_SCENES) --seed $(TABLE_SEED) --spec $* --workers $(WORKERS) -o $@

$(PLANS): $(SOURCES) | $(SCENES)
	$(RETRIEVE) plan $(@D)/scenes.jsonl --policy $(call decoded,$(word 1,$(subst ., ,$(@F)))) --rule $(word 2,$(subst ., ,$(@F))) \
		--workers $(WORKERS) -o $@

$(SENSED): $(SOURCES) | $(SCENES)
	$(RETRIEVE) plan $(@D)/scenes.jsonl --sense --policy $(call decoded,$(word 1,$(subst ., ,$(@F)))) --workers $(WORKERS) -o $@

$(VENV)/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt pip
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) out build *.egg-info
