# SPDX-License-Identifier: GPL-2.0-or-later
# The front door. Does nothing itself: everything is in tools/.
#
#   CLIP=my.y4m    the clip for `make run`
#   SOURCE=vivid   how it comes in: clip (replayed, if not set), vivid (shown to a camera)
#   ACCEL=tcg|kvm  QEMU's acceleration, instead of finding out what works
#   BOARD=miniitx  which image, instead of the development image: run, test, image, flash
#   FIRMWARE=uefi  which of the board's firmwares, bios or uefi: run, test
#   T=...          which tests, as pytest's -k expression; for `make test-long` also the name of a campaign
#   ARGS='...'     options of a campaign: make test-long T=powercut ARGS='-cuts 100'; docs/testing.md
#   EXTERNAL=path[:path]  trees outside of ours: build, image, sdk, test; docs/programs.md
#   JUNIT=file     for `make test`: the outcome of all tests as JUnit XML; docs/ci.md
#   ROUNDS=, CASES=, BEFORE=commit  for `make bench`: docs/bench.md
#   KEY=, SERIAL=, OLDEST=, UPDATE_KEYS=, UPDATE=, ROBOTS=  for updates, and what an image accepts: docs/update.md
#   DEV=           and more for `make flash`: docs/flash.md

PYTHON = /usr/bin/python3 -B

# A relative name is that of a file where `make` was called, which with `make -C` is not here.
CALLED_IN = $(if $(findstring w,$(firstword -$(MAKEFLAGS))),$(PWD),$(CURDIR))
JUNIT_WORDS = $(if $(JUNIT),-junit '$(if $(filter /%,$(JUNIT)),,$(CALLED_IN)/)$(JUNIT)')

RUN_BENCH = $(if $(ROUNDS),-rounds '$(ROUNDS)') $(if $(CASES),-cases '$(CASES)') $(if $(BEFORE),-before '$(BEFORE)')

# Long runs with options of their own, each a program in tools/.
CAMPAIGNS = bench-record crash endurance fuzz killed newmachine powercut reproduce
CAMPAIGN = $(if $(filter 1,$(words $(T))),$(filter $(T),$(CAMPAIGNS)))
RUN_CAMPAIGN = $(if $(filter bench-record,$(T)),tools/bench record $(ARGS),$(PYTHON) tools/$(if \
	$(filter reproduce,$(T)),buildroot.py reproduce "$(BOARD)",$(CAMPAIGN).py $(ARGS)))

.PHONY: help setup setup-run setup-build build run boot test test-long results again defects image sdk bench legal sbom lint flash \
	update update-key rollout \
	docs desktop clean distclean

# Targets with ## are those of every day; the others are for release and repair.
help:
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 20
	@echo '  Others, see docs/testing.md: setup defects results docs legal sbom distclean'
setup:           # install what building and testing need (Debian packages)
	@tools/setup run build test
setup-run:
	@tools/setup run
setup-build:
	@tools/setup run build
build: setup-build  ## build the programs and the development image, output/dev/disk.img
	@$(PYTHON) tools/build.py
# Its tool installs part `run` itself, while it builds.
run:             ## a clip through the appliance in QEMU, frame by frame; output/report.json
	@tools/preflight output/run/dev/disk.img run
	@tools/setup
	@$(PYTHON) tools/run.py "$(CLIP)"
boot: setup-build ## the image in QEMU, to look around: console, SSH, VNC; BOARD=, until it is switched off
	@$(PYTHON) tools/boot_image.py "$(BOARD)"
test: setup      ## the gate: all tests but the long ones, in 15 minutes; STRICT=1: without second chances; JUNIT=file.xml
	@$(PYTHON) tools/gate.py $(JUNIT_WORDS) $(if $(T),'$(T)')
test-long: setup ## tests of minutes and hours; T=crash, powercut, killed, endurance, fuzz, newmachine, reproduce: a campaign
	@tools/setup $(if $(filter reproduce,$(CAMPAIGN)),image,long)
	@$(if $(CAMPAIGN),$(RUN_CAMPAIGN),$(PYTHON) tools/gate.py -long $(JUNIT_WORDS) $(if $(T),'$(T)'))
again: setup     ## chosen tests TIMES=10 times: T= in Python, C='name' in C, LOAD=1 beside busy processors
	@$(PYTHON) tools/again.py $(if $(TIMES),-times '$(TIMES)') $(if $(LOAD),-load) $(if $(C),-c '$(C)') $(if $(T),'$(T)')
defects: setup   # put defects back that once were: the test against each turns red; T= words of a name
	@$(PYTHON) tools/defects.py $(T)
image:           ## build the product with Buildroot: BOARD=miniitx|pc104, output/<board>/disk.img; an hour the first time
	@tools/setup run image
	@$(PYTHON) tools/buildroot.py image "$(BOARD)"
sdk:             ## a compiler for programs of the product's image: BOARD=, output/<board>/ddxvideo-<board>-sdk.tar.gz
	@tools/setup run image
	@$(PYTHON) tools/buildroot.py sdk "$(BOARD)"
results:         # output/results.md: what the long runs have measured, by commit
	@$(PYTHON) tools/results.py
bench:           ## the store beside other ways to pass frames: ROUNDS=, CASES=, BEFORE=commit, see docs/bench.md
	@tools/setup run build bench
	@tools/bench store $(RUN_BENCH)
	@$(if $(CASES)$(BEFORE),:,tools/bench stream)
	@$(if $(CASES)$(BEFORE),:,tools/bench loss)
	@$(if $(CASES)$(BEFORE),:,tools/bench replay)
	@$(if $(CASES)$(BEFORE),:,tools/bench stereo)
	@$(if $(CASES)$(BEFORE),:,tools/bench view)
	@$(if $(CASES)$(BEFORE),:,tools/bench catalog)
	@$(if $(CASES)$(BEFORE),:,tools/bench mp4)
# Only words of the command line count: a HOSTNAME or DEV that happens to be in the environment must not.
FLASH_WORDS = BOARD DEV IMAGE YES FILE SSH_KEY HOSTNAME NETWORK CONSOLE SERIAL
TYPED = $(foreach word,$(FLASH_WORDS),$(if $(findstring command,$(origin $(word))),$(word)='$($(word))'))
flash: setup-run ## write an image to a disk and compare: BOARD=dev DEV=/dev/sdX, see docs/flash.md
	@$(PYTHON) tools/flash.py $(TYPED)
update: setup-run ## an update file from a board's image, signed: BOARD=dev KEY=file, see docs/update.md
	@$(PYTHON) tools/update.py file "$(BOARD)" "$(KEY)"
rollout: setup-run ## an update onto many robots, by ssh: UPDATE=file ROBOTS=file (a name a line), see docs/update.md
	@$(PYTHON) tools/rollout.py "$(UPDATE)" "$(ROBOTS)"
update-key: setup-run # a pair of keys for updates, with a password: KEY=file
	@$(PYTHON) tools/update.py key "$(KEY)"
docs: setup      # type every command of docs/technician.md into the image, and take its pictures: BOARD=
	@$(PYTHON) tools/docs.py "$(BOARD)"
legal:           # licences and sources of all that is in an image: BOARD=, see docs/licences.md
	@tools/setup run image
	@$(PYTHON) tools/legal.py "$(BOARD)"
sbom:            # list of all that is in an image (CycloneDX): BOARD=
	@tools/setup run image
	@$(PYTHON) tools/sbom.py "$(BOARD)"
lint: setup      ## check scripts, tools and sources without running them
	@$(PYTHON) tools/lint.py
desktop: setup-build  ## install the store, its library and Python module: PREFIX=/usr/local, DESTDIR=
	@$(PYTHON) tools/desktop.py "$(or $(PREFIX),/usr/local)" "$(DESTDIR)"
clean:           ## remove what was built, keep what was downloaded
	@tools/clean
distclean:       # remove all output
	@tools/clean all
