"""What no schema knows of the manifests: selectors, names and settings, the latter asked of the program.

    check.py PROGRAM METRICS FILE...      rendered manifests of Kubernetes, or files of Compose
"""

import base64
import pathlib
import re
import subprocess
import sys
import tempfile

import yaml

HERE = pathlib.Path(__file__).resolve().parent
PARTS = ("Deployment", "StatefulSet", "Job")
# Time for the pause before the stop and for what follows drain_s, s.
AROUND_DRAIN = 45
faults = []


def main():
    program, rules, files = sys.argv[1], yaml.safe_load(pathlib.Path(sys.argv[2]).read_text()), sys.argv[3:]
    for file in files:
        documents = [d for d in yaml.safe_load_all(pathlib.Path(file).read_text()) if d]
        if "services" in documents[0]:
            compose(program, documents[0])
        else:
            kubernetes(program, documents, rules)
    for fault in faults:
        print("check.py: " + fault)
    sys.exit(bool(faults))


def expect(right, fault):
    if not right:
        faults.append(fault)


def compose(program, document):
    values = {"PROSOPON_KEYS": keys(program)}
    for name, service in document["services"].items():
        if service["image"] != "prosopon":
            expect(re.search(r":\d+\.\d+", service["image"]), "%s: the image has no fixed version" % name)
            continue
        given = {
            key: re.sub(r"\$\{(\w+)[^}]*\}", lambda m: values.get(m[1], "secret"), str(value))
            for key, value in service.get("environment", {}).items()
        }
        if "command" in service:
            runs(program, name, service["command"], given)


def keys(program):
    return '[{id="front",tenant="hospital-a",scopes=["read","write"],hash="%s"}]' % new_hash(program)


def new_hash(program):
    key = subprocess.run([program, "auth", "key", "--id", "check"], check=True, capture_output=True, text=True).stdout
    return re.search(r'hash = "(.*)"', key)[1]


def kubernetes(program, documents, rules):
    named = {(d["kind"], d["metadata"]["name"]): d for d in documents}
    expect(len(named) == len(documents), "two objects have one name")
    parts = [d for d in documents if d["kind"] in PARTS]
    pods = [d["spec"]["template"] for d in parts]
    expect(parts, "there is nothing to run")

    def selects(what, selector):
        wanted = selector.get("matchLabels", selector).items()
        expect(any(wanted <= pod["metadata"]["labels"].items() for pod in pods), "%s selects no pod" % what)

    for (kind, name), document in named.items():
        spec, what = document.get("spec", {}), "%s %s" % (kind, name)
        if kind in ("Deployment", "StatefulSet", "PodDisruptionBudget"):
            selects(what, spec["selector"])
        if kind == "Service":
            selects(what, spec["selector"])
        if kind == "NetworkPolicy":
            selects(what, spec["podSelector"])
        if kind == "StatefulSet":
            expect(("Service", spec["serviceName"]) in named, "%s: no Service %s" % (what, spec["serviceName"]))
        if kind == "HorizontalPodAutoscaler":
            target = spec["scaleTargetRef"]
            expect((target["kind"], target["name"]) in named, "%s: no %s %s" % (what, target["kind"], target["name"]))
            metrics(spec["metrics"], rules)
        if kind == "Ingress":
            for rule in spec["rules"]:
                for path in rule["http"]["paths"]:
                    service = path["backend"]["service"]
                    found = named.get(("Service", service["name"]), {"spec": {"ports": []}})
                    ports = [port["name"] for port in found["spec"]["ports"]]
                    expect(service["port"]["name"] in ports, "%s: no such port of a Service %s" % (what, service["name"]))
    for part in parts:
        pod(program, named, part)


def metrics(wanted, rules):
    """The adapter's rules make the metric, of what the program tells."""
    made = {rule["name"]["as"]: rule["metricsQuery"] for rule in rules["externalRules"]}
    source = "".join(p.read_text() for p in (HERE.parent / "src").rglob("*.rs"))
    for metric in wanted:
        name = metric["external"]["metric"]["name"]
        expect(name in made, "no rule makes the metric %s" % name)
        for told in re.findall(r"\b(prosopon_\w+)\{", made.get(name, "")):
            expect('"%s"' % told in source, "the program tells no %s" % told)


def pod(program, named, part):
    what = "%s %s" % (part["kind"], part["metadata"]["name"])
    spec = part["spec"]["template"]["spec"]
    expect(spec.get("enableServiceLinks") is False, "%s: variables of Services would be read as settings" % what)
    expect(spec.get("automountServiceAccountToken") is False, "%s: has a token of the cluster" % what)
    secure = spec["securityContext"]
    expect(secure.get("runAsNonRoot") and secure["seccompProfile"]["type"] == "RuntimeDefault", "%s: rights" % what)
    volumes = {volume["name"]: volume for volume in spec["volumes"]}
    volumes.update({claim["metadata"]["name"]: {} for claim in part["spec"].get("volumeClaimTemplates", [])})
    for container in spec["containers"]:
        own = container["securityContext"]
        expect(own["readOnlyRootFilesystem"] and not own["allowPrivilegeEscalation"], "%s: rights" % what)
        expect(own["capabilities"] == {"drop": ["ALL"]}, "%s: capabilities" % what)
        expect("memory" in container["resources"]["limits"], "%s: memory without a limit" % what)
        expect(":" in container["image"], "%s: an image without a version" % what)
        for mount in container["volumeMounts"]:
            expect(mount["name"] in volumes, "%s: no volume %s" % (what, mount["name"]))
        given = {e["name"]: e["value"] for e in container.get("env", [])}
        for source in container["envFrom"]:
            secret = named.get(("Secret", source["secretRef"]["name"]))
            expect(secret, "%s: no Secret %s" % (what, source["secretRef"]["name"]))
            given.update(decoded(secret) if secret else {})
        if "PROSOPON_AUTH__KEYS" in given:
            # One hash a key: the program refuses two keys of one token.
            given["PROSOPON_AUTH__KEYS"] = re.sub('"HASH"', lambda _: '"%s"' % new_hash(program), given["PROSOPON_AUTH__KEYS"])
        files = {}
        for mount in container["volumeMounts"]:
            configmap = volumes.get(mount["name"], {}).get("configMap", {"optional": True})
            found = named.get(("ConfigMap", configmap.get("name")))
            expect(found or configmap.get("optional"), "%s: no ConfigMap %s" % (what, configmap.get("name")))
            for name, text in (found or {}).get("data", {}).items():
                files[mount["mountPath"] + "/" + name] = text
        printed = runs(program, what, container["args"], given, files)
        drain = re.search(r"^drain_s = (\d+)$", printed, re.M)
        if drain:
            needed = int(drain[1]) + AROUND_DRAIN
            expect(spec["terminationGracePeriodSeconds"] >= needed, "%s: a stop may take %d s" % (what, needed))


def decoded(secret):
    return {key: base64.b64decode(value).decode() for key, value in secret["data"].items()}


def runs(program, what, arguments, given, files=None):
    """Whether the program takes the subcommand, its flags and its settings: what it prints of them."""
    call, flags = arguments[0], arguments[1:]
    with tempfile.TemporaryDirectory() as scratch:
        if "PROSOPON_CONFIG" in given:
            text = (files or {}).get(given["PROSOPON_CONFIG"])
            expect(text, "%s: no file %s" % (what, given["PROSOPON_CONFIG"]))
            file = pathlib.Path(scratch) / "prosopon.toml"
            file.write_text(text or "")
            given = dict(given, PROSOPON_CONFIG=str(file))
        printed = ""
        calls = [[call, *flags, "--help"]]
        if call in ("serve", "worker"):
            calls.append(["config", "check", *flags])
        for one in calls:
            done = subprocess.run([program, *one], env=given, capture_output=True, text=True)
            said = done.stderr.strip().replace("\n", "; ")
            expect(done.returncode == 0, "%s: prosopon %s: %s" % (what, " ".join(one), said))
            printed = done.stdout
        return printed


if __name__ == "__main__":
    main()
