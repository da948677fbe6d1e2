################################################################################
#
# ddxservice
#
################################################################################

DDXSERVICE_VERSION = $(DDX_VERSION)
DDXSERVICE_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddxservice
DDXSERVICE_SITE_METHOD = local
DDXSERVICE_LICENSE = GPL-2.0+
DDXSERVICE_LICENSE_FILES = LICENSES/GPL-2.0.txt
DDXSERVICE_POST_RSYNC_HOOKS += DDXVIDEO_COPY_LICENSES
DDXSERVICE_USERS = $(call ddx-users,ddxservice)

$(eval $(meson-package))
