{{- define "quadmeshd.labels" -}}
app.kubernetes.io/name: quadmeshd
app.kubernetes.io/instance: {{ .Release.Name }}
{{- end }}
