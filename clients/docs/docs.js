// Shows the daemon's own description. Nothing is loaded from elsewhere, and no validator is asked.
window.SwaggerUIBundle({
  url: "/openapi.yaml",
  dom_id: "#viewer",
  deepLinking: true,
  docExpansion: "list",
  validatorUrl: null,
});
