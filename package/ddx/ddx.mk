################################################################################
#
# ddx
#
################################################################################

# The release's number is in meson.build, for all packages.
DDX_VERSION := $(shell sed -n "s/^  version: '\(.*\)',$$/\1/p" \
	$(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddx/meson.build)
DDX_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddx
DDX_SITE_METHOD = local
DDX_LICENSE = LGPL-2.1+ (libddx), GPL-2.0+ (programs, scripts)
DDX_LICENSE_FILES = LICENSE LICENSES/LGPL-2.1.txt LICENSES/GPL-2.0.txt
DDX_POST_RSYNC_HOOKS += DDXVIDEO_COPY_LICENSES
DDX_INSTALL_STAGING = YES
DDX_USERS = $(call ddx-users,ddx)
DDX_POST_INSTALL_TARGET_HOOKS += DDXVIDEO_INSTALL_INIT_SCRIPTS

$(eval $(meson-package))
