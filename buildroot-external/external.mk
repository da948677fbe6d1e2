# SPDX-License-Identifier: GPL-2.0-or-later
# Includes the makefiles of the project's packages; board/ and tools/ are used from there, too.

DDXVIDEO_TOP = $(BR2_EXTERNAL_DDXVIDEO_PATH)/..
DDXVIDEO_PYTHON = PYTHONPATH=$(DDXVIDEO_TOP)/tools python3 -B

# The users of a package's programs, from its programs.txt, in the form of Buildroot's users tables; the package may be
# in any tree.
ddx-users = $(subst |,$(sep),$(shell awk '/^[a-z.]/ && $$4 ~ /^[0-9]+$$/ { \
	printf "%s %s ddx 900 * - /bin/false -", $$3, $$4; for (i = 5; i <= NF; i++) printf " %s", $$i; printf "|" }' \
	$(wildcard $(patsubst %,%/package/$(1)/programs.txt,$(DDXVIDEO_TOP) $(BR2_EXTERNAL_DIRS))) /dev/null))

# The texts of LICENSES that a package names, for legal-info, which reads the package's folder only. A hook after rsync.
define DDXVIDEO_COPY_LICENSES
	$(foreach text,$(filter LICENSES/%,$($(PKG)_LICENSE_FILES)), \
		$(INSTALL) -D -m 0644 $(DDXVIDEO_TOP)/$(text) $(@D)/$(text)
	)
endef

# A package's patches, for NAME_OVERRIDE_SRCDIR as well: Buildroot patches only what it has downloaded. A hook after
# rsync.
define DDXVIDEO_PATCH_OVERRIDDEN
	test -e $(@D)/.applied_patches_list || { \
		$(foreach folder,$(wildcard $($(PKG)_PKGDIR) \
				$(addsuffix /$($(PKG)_RAWNAME),$(call qstrip,$(BR2_GLOBAL_PATCH_DIR)))), \
			$(APPLY_PATCHES) $(@D) $(folder) \*.patch && ) true; }
endef
LINUX_POST_RSYNC_HOOKS += DDXVIDEO_PATCH_OVERRIDDEN

# The init scripts of a package's services, from its programs.txt. A hook after the installation.
define DDXVIDEO_INSTALL_INIT_SCRIPTS
	$(DDXVIDEO_TOP)/board/common/init-scripts $(@D) $(TARGET_DIR)
endef

# Other trees' files for the root file system; later ones override. This tree's are in the boards' configurations.
BR2_ROOTFS_OVERLAY := $(call qstrip,$(BR2_ROOTFS_OVERLAY)) $(wildcard $(addsuffix /overlay,$(BR2_EXTERNAL_DIRS)))

include $(sort $(wildcard $(DDXVIDEO_TOP)/package/*/*.mk))

# Kconfig silently drops options whose dependencies are off; a camera's driver must not be lost that way.
define DDXVIDEO_LINUX_CHECK_CONFIG
	$(DDXVIDEO_PYTHON) -m parts.image.buildroot_fragments $(@D)/.config \
		$(LINUX_KCONFIG_FILE) $(LINUX_KCONFIG_FRAGMENT_FILES)
endef
LINUX_POST_CONFIGURE_HOOKS += DDXVIDEO_LINUX_CHECK_CONFIG

# BusyBox. Buildroot completes a short configuration with BusyBox's defaults, which are mostly on; this runs after that.
define DDXVIDEO_BUSYBOX_CONFIG
	$(DDXVIDEO_PYTHON) -m parts.image.buildroot_busybox $(@D) env $(BUSYBOX_KCONFIG_MAKE)
endef
PACKAGES_BUSYBOX_CONFIG_FIXUPS += $(DDXVIDEO_BUSYBOX_CONFIG)$(sep)

# The boot menu, the same for all boards and both slots, expects this name of the kernel.
define DDXVIDEO_LINUX_INSTALL_KERNEL
	$(INSTALL) -D -m 0644 $(LINUX_IMAGE_PATH) $(TARGET_DIR)/boot/vmlinuz
endef
LINUX_POST_INSTALL_TARGET_HOOKS += DDXVIDEO_LINUX_INSTALL_KERNEL

# GRUB: post-image.sh makes the boot loader from these; Buildroot's sample menu is kept out of the root.
define DDXVIDEO_GRUB2_INSTALL_MODULES
	$(foreach tuple,$(GRUB2_TUPLES-y), \
		mkdir -p $(HOST_DIR)/lib/grub/$(tuple)
		cp $(addprefix $(@D)/build-$(tuple)/grub-core/,*.img *.lst *.mod) \
			$(HOST_DIR)/lib/grub/$(tuple)/
	)
endef
GRUB2_POST_INSTALL_IMAGES_HOOKS += DDXVIDEO_GRUB2_INSTALL_MODULES
GRUB2_CFG_i386-pc = $(BINARIES_DIR)/grub-sample.cfg

# Built with its assembly code, x264 refuses to run on a processor that has MMX only, and is compiled for SSE2.
ifeq ($(BR2_X86_CPU_HAS_SSE2),)
X264_CONF_OPTS += --disable-asm
endif

# Pictures have 8 bits; code for 10 is as large once more.
X264_CONF_OPTS += --bit-depth=8

# Neither Wi-Fi Direct, which Buildroot's option for an access point brings, nor TDLS: nothing here uses them, and both
# listen to the radio.
WPA_SUPPLICANT_CONFIG_ENABLE := $(filter-out CONFIG_P2P,$(WPA_SUPPLICANT_CONFIG_ENABLE))
WPA_SUPPLICANT_CONFIG_DISABLE += CONFIG_P2P CONFIG_TDLS

# Programs and libraries that no frame passes through, compiled for size
CYCLONEDDS_CONF_OPTS += -DCMAKE_C_FLAGS="$(TARGET_CFLAGS) -Os"
RSYNC_CONF_ENV += CFLAGS="$(TARGET_CFLAGS) -Os"
UTIL_LINUX_CONF_ENV += CFLAGS="$(TARGET_CFLAGS) -Os -Dstatic_assert=_Static_assert"
WPA_SUPPLICANT_CFLAGS += -Os

# SSH takes keys only (libexec/ddx/ssh): without crypt(), the server has no code for passwords.
DROPBEAR_CONF_ENV += ac_cv_lib_crypt_crypt=no CFLAGS="$(TARGET_CFLAGS) -DDROPBEAR_SVR_PASSWORD_AUTH=0"

# libsrtp2 with its own cryptography, even if the image has OpenSSL or NSS. OpenSSL's licence is not compatible with
# x264's, which is in the same process, and both libraries take too long to start for each received source.
LIBSRTP_CONF_OPTS += --disable-openssl --disable-nss

# Files that each boot reads lie in the squashfs unpacked; post-build.sh makes the list from board/common/boot-files.txt.
# So do all kernel modules: unpacking those of a USB camera from xz takes nine times as long as loading them, and they come
# before the first frame. Buildroot has no option that passes on further words.
ROOTFS_SQUASHFS_ARGS += -Xbcj x86 -noI -action-file $(BASE_DIR)/boot-files.actions \
	-action 'uncompressed@name(*.ko)' -action 'no-fragments@name(*.ko)'
