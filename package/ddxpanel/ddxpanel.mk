################################################################################
#
# ddxpanel
#
################################################################################

DDXPANEL_VERSION = $(DDX_VERSION)
DDXPANEL_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddxpanel
DDXPANEL_SITE_METHOD = local
DDXPANEL_LICENSE = GPL-2.0+
DDXPANEL_LICENSE_FILES = LICENSES/GPL-2.0.txt
DDXPANEL_POST_RSYNC_HOOKS += DDXVIDEO_COPY_LICENSES
DDXPANEL_DEPENDENCIES = ddx mbedtls
DDXPANEL_USERS = $(call ddx-users,ddxpanel)
DDXPANEL_POST_INSTALL_TARGET_HOOKS += DDXVIDEO_INSTALL_INIT_SCRIPTS

# Of lighttpd, the image has the server and the modules that panel.conf names: no sample pages, no configuration. Of
# mdnsd, only the daemon: ddxpanel starts it with a file of its own, panel.service.
define DDXPANEL_REDUCE_SERVERS
	rm -rf $(TARGET_DIR)/etc/lighttpd $(TARGET_DIR)/etc/mdns.d $(TARGET_DIR)/var/www
	rm -f $(TARGET_DIR)/usr/sbin/lighttpd-angel
	find $(TARGET_DIR)/usr/lib/lighttpd -name 'mod_*.so' ! -name mod_mbedtls.so -delete
endef
DDXPANEL_TARGET_FINALIZE_HOOKS += DDXPANEL_REDUCE_SERVERS

$(eval $(meson-package))
