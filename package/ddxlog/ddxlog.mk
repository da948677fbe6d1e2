################################################################################
#
# ddxlog
#
################################################################################

DDXLOG_VERSION = $(DDX_VERSION)
DDXLOG_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddxlog
DDXLOG_SITE_METHOD = local
DDXLOG_LICENSE = GPL-2.0+
DDXLOG_LICENSE_FILES = LICENSES/GPL-2.0.txt
DDXLOG_POST_RSYNC_HOOKS += DDXVIDEO_COPY_LICENSES
DDXLOG_DEPENDENCIES = ddx lz4
DDXLOG_USERS = $(call ddx-users,ddxlog)
DDXLOG_POST_INSTALL_TARGET_HOOKS += DDXVIDEO_INSTALL_INIT_SCRIPTS

$(eval $(meson-package))
