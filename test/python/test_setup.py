# SPDX-License-Identifier: MIT
"""tools/setup.sh in a project of its own, with a PATH on which apt-get, pip, gfortran and the others are stand-ins.

Nothing is installed and no network is used: the stand-ins note their calls, and files in a folder switch what they do.
"""

import os
import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NOBODY = 65534
REAL = """
    bash sh env cat cp dirname find flock grep head ln make mkdir mv paste realpath rm sed stat tail timeout true
""".split()

# Each stand-in notes its call in $FAKE/calls; $FAKE/absent lists what gfortran does not find.
STAND_INS = {
    "gfortran": """
        case $1 in
        -dumpversion) cat "$FAKE/version" ;;
        -print-file-name=*) name=${1#*=}; grep -qx "$name" "$FAKE/absent" && echo "$name" || echo "/lib/$name" ;;
        esac""",
    "id": 'cat "$FAKE/uid"',
    "dpkg": 'grep -q hdf5 "$FAKE/absent" || echo "$FAKE/hdf5/serial/hdf5.mod"',
    "apt-get": """
        echo "DEBIAN_FRONTEND=$DEBIAN_FRONTEND" >>"$FAKE/calls"
        [ ! -e "$FAKE/apt-fails" ] || { echo "E: Unable to locate package" >&2; exit 100; }
        [ "$1" = install ] || exit 0
        [ -e "$FAKE/apt-helps-not" ] || : >"$FAKE/absent" """,
    "c++": "",
    "cmake": "",
    "pkg-config": "",
    "valgrind": "",
    "python3": """
        case $2 in
        import*) ! grep -qx venv "$FAKE/absent" ;;
        venv)
            [ ! -e "$FAKE/venv-fails" ] || { echo "Error: no space left" >&2; mkdir -p .venv/bin; exit 1; }
            mkdir -p .venv/bin; cp "$FAKE/bin/python-in-venv" .venv/bin/python ;;
        esac""",
    "python-in-venv": """
        [ ! -e "$FAKE/pip-fails" ] || { echo "ERROR: No matching distribution found" >&2; exit 1; }
        case $3 in
        install) cp "$FAKE/bin/fpm-in-venv" .venv/bin/fpm ;;
        download)
            case $* in *requirements-site*) mkdir -p .deps/site; exit 0 ;; esac
            for name in toml-f:0.5.1 test-drive:0.6.0; do
                folder=$TMPDIR/pip-download-x/subprojects/${name%:*}
                mkdir -p "$folder/src"
                echo "module x; end module" >"$folder/src/x.f90"
                printf 'name = "%s"\\nversion = "%s"\\n' "${name%:*}" "${name#*:}" >"$folder/fpm.toml"
            done
            echo "ModuleNotFoundError: No module named 'mesonpy'" >&2; exit 1 ;;
        esac""",
    "fpm-in-venv": """
        case $1 in
        --version) echo "Version:     0.12.0, alpha" ;;
        update) [ ! -e "$FAKE/fpm-fails" ] || { echo "<ERROR> no" >&2; exit 1; }; mkdir -p build; : >build/cache.toml ;;
        esac""",
    "git": """
        case $* in
        ls-remote*) [ -e "$FAKE/reachable" ] || { echo "fatal: Could not resolve host" >&2; exit 128; } ;;
        *clone*)
            folder=${!#}
            "$FAKE/git" init -q "$folder"
            [ ! -e "$FAKE/clone-fails" ] || { echo "fatal: early EOF" >&2; exit 128; }
            mkdir "$folder/src"
            all=$*; version=${all#*--branch v}
            echo "version = \\"${version%% *}\\"" >"$folder/fpm.toml"
            "$FAKE/git" -C "$folder" -c user.name=a -c user.email=a commit -q --allow-empty -m cloned ;;
        *) exec "$FAKE/git" "$@" ;;
        esac""",
}


class SetUp(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.top = Path(temporary.name).resolve()
        self.top.chmod(0o755)
        self.project = self.top / "project"
        self.fake = self.top / "fake"
        self.bin = self.fake / "bin"
        for folder in (self.bin, self.fake / "hdf5" / "serial", self.project / "io", self.project / "test",
                       self.project / "tools"):
            folder.mkdir(parents=True)
        for name in ("fpm.toml", "io/fpm.toml", "test/fpm.toml", "tools/setup.sh"):
            shutil.copy(ROOT / name, self.project / name)
        shutil.copytree(ROOT / "config", self.project / "config")
        for name in REAL:
            (self.bin / name).symlink_to(shutil.which(name))
        (self.fake / "git").symlink_to(shutil.which("git"))
        for name, body in STAND_INS.items():
            self.stand_in(name, body)
        (self.fake / "hdf5" / "serial" / "hdf5.mod").touch()
        self.state(uid="0\n", version="12.2.0\n", absent="", calls="")

    def stand_in(self, name, body):
        script = self.bin / name
        script.write_text(f'#!/bin/bash\necho "{name} $*" >>"$FAKE/calls"\n{body}\n')
        script.chmod(0o755)

    def state(self, **files):
        for name, text in files.items():
            (self.fake / name.replace("_", "-")).write_text(text)

    def calls(self):
        return (self.fake / "calls").read_text().splitlines()

    def run_setup(self, *arguments, expect=0, **options):
        """Run the script; return the lines that it wrote."""
        environment = {
            "PATH": str(self.bin),
            "FAKE": str(self.fake),
            "HOME": str(self.top),
            "GIT_CONFIG_NOSYSTEM": "1",
            **options.pop("environment", {}),
        }
        done = subprocess.run(
            ["tools/setup.sh", *arguments],
            cwd=self.project,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=60,
            **options,
        )
        self.assertEqual(done.returncode, expect, done.stdout)
        return done.stdout.splitlines()

    def assert_ready(self):
        for name in ("toml-f", "test-drive"):
            self.assertEqual(self.head(name), 40)
            self.assertTrue((self.project / "build/dependencies" / name / "fpm.toml").is_file())
        self.assertTrue((self.project / "io/include/hdf5/hdf5.mod").is_file())
        self.assertTrue((self.project / "build/cache.toml").is_file())
        self.assertEqual(self.run_setup(), [])

    def head(self, name):
        """The length of the commit's name in a seeded repository: 40 if there is one."""
        command = [
            "git",
            "--git-dir",
            str(self.project / "build/dependencies" / name / ".git"),
            "rev-parse",
            "-q",
            "--verify",
            "HEAD",
        ]
        return len(subprocess.run(command, capture_output=True, text=True).stdout.strip())

    # --- what it does -------------------------------------------------------------------------------------------------

    def test_bare_machine_is_set_up(self):
        self.state(absent="crt1.o\nliblapack.so\nlibhdf5_serial.so\nvenv\n")
        lines = self.run_setup()
        self.assertIn("setup: all is there. To call fpm yourself: . .venv/bin/activate", lines)
        calls = self.calls()
        update = calls.index("apt-get update")
        install = next(call for call in calls if call.startswith("apt-get install -y"))
        self.assertLess(update, calls.index(install))
        for package in ("libc6-dev", "libopenblas-dev", "libhdf5-dev", "python3-venv"):
            self.assertIn(package, install.split())
        self.assertNotIn("gfortran", install.split())
        self.assertIn("DEBIAN_FRONTEND=noninteractive", calls)
        self.assert_ready()

    def test_nothing_missing_costs_nothing(self):
        self.run_setup("test")
        self.state(calls="")
        self.assertEqual(self.run_setup("test"), [])
        for call in self.calls():
            self.assertFalse(call.startswith(("apt-get", "python-in-venv", "sudo", "git ls-remote")), call)

    def test_test_packages_come_only_for_the_tests(self):
        self.run_setup()
        self.assertFalse(any("requirements-test" in call for call in self.calls()))
        self.run_setup("test")
        self.assertTrue(any("requirements-test" in call for call in self.calls()))

    def test_tools_of_the_examples_come_only_for_the_tests(self):
        for name in ("c++", "cmake", "pkg-config"):
            (self.bin / name).unlink()
        self.run_setup()
        self.assertFalse(any(call.startswith("apt-get") for call in self.calls()))
        self.run_setup("test", expect=2)  # the stand-in for apt-get brings none of them
        install = next(call for call in self.calls() if call.startswith("apt-get install -y"))
        self.assertEqual(install.split()[-3:], ["g++", "pkg-config", "cmake"])

    def test_sundials_comes_only_for_the_benchmark(self):
        self.run_setup("test")
        self.assertFalse(any("libsundials-dev" in call for call in self.calls()))
        self.state(absent="libsundials_ida.so\n")
        self.run_setup("bench")
        install = next(call for call in self.calls() if call.startswith("apt-get install -y"))
        self.assertIn("libsundials-dev", install.split())

    def test_openblas_without_threads_comes_only_for_wheels(self):
        self.state(absent="openblas-serial/libopenblas.a\n")
        self.run_setup()
        self.run_setup("python")
        self.assertFalse(any("libopenblas-serial-dev" in call for call in self.calls()))
        self.run_setup("wheel")
        install = next(call for call in self.calls() if call.startswith("apt-get install -y"))
        self.assertEqual(install.split()[-1], "libopenblas-serial-dev")

    def test_packages_of_the_reference_come_only_for_it(self):
        self.run_setup("test")
        for name in ("docs", "site"):
            self.assertFalse(any(f"requirements-{name}" in call for call in self.calls()))
        self.run_setup("docs")
        for name in ("docs", "site"):
            self.assertTrue(any(f"requirements-{name}" in call for call in self.calls()))

    def test_sudo_without_a_password_installs(self):
        self.state(uid="1000\n", absent="liblapack.so\n")
        self.stand_in("sudo", 'shift; exec "$@"')
        self.run_setup()
        self.assertIn("sudo -n env DEBIAN_FRONTEND=noninteractive apt-get update", self.calls())
        self.assert_ready()

    def test_git_variables_of_a_hook_are_ignored(self):
        self.run_setup(environment={"GIT_DIR": "/nonexistent", "GIT_WORK_TREE": "/nonexistent"})
        self.assert_ready()

    def test_reachable_repository_is_cloned(self):
        self.state(reachable="")
        self.run_setup()
        self.assertFalse(any("pip download" in call for call in self.calls()))
        self.assert_ready()

    def test_fpm_on_the_path_stands_in_where_pip_has_none(self):
        self.run_setup()
        shutil.rmtree(self.project / ".venv")
        self.state(pip_fails="")
        self.stand_in("fpm", STAND_INS["fpm-in-venv"])
        lines = self.run_setup()
        self.assertIn(f"setup: using {self.bin / 'fpm'} instead", lines)
        self.assert_ready()

    # --- what it mends ------------------------------------------------------------------------------------------------

    def test_seeded_folders_are_renewed_without_a_network(self):
        self.run_setup()
        shutil.rmtree(self.project / "build")
        self.state(pip_fails="")
        self.run_setup()
        self.assert_ready()

    def test_empty_repository_is_replaced(self):
        self.run_setup()
        folder = self.project / "build/dependencies/toml-f"
        shutil.rmtree(folder)
        subprocess.run(["git", "init", "-q", str(folder)], check=True)
        self.run_setup()
        self.assert_ready()

    def test_folder_that_is_no_repository_is_replaced(self):
        # The project itself may be a repository: its commit must not pass for the dependency's.
        subprocess.run(["git", "init", "-q", str(self.project)], check=True)
        git = ["git", "-C", str(self.project), "-c", "user.name=a", "-c", "user.email=a", "-c", "commit.gpgsign=false"]
        subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "ours"], check=True)
        self.run_setup()
        for place in (".deps/toml-f-v0.5.1", "build/dependencies/toml-f"):
            shutil.rmtree(self.project / place / ".git")
        self.run_setup()
        self.assert_ready()

    def test_other_version_is_replaced(self):
        self.run_setup()
        manifest = self.project / "build/dependencies/test-drive/fpm.toml"
        manifest.write_text(manifest.read_text().replace("0.6.0", "0.5.0"))
        self.run_setup()
        self.assertIn("0.6.0", manifest.read_text())
        self.assert_ready()

    def test_half_made_environment_is_made_anew(self):
        (self.project / ".venv/bin").mkdir(parents=True)
        shutil.copy(self.bin / "python-in-venv", self.project / ".venv/bin/python")
        (self.project / ".venv/left-over").touch()
        self.run_setup()
        self.assertFalse((self.project / ".venv/left-over").exists())
        self.assert_ready()

    def test_environment_of_a_moved_checkout_is_made_anew(self):
        self.run_setup()
        moved = self.top / "moved"
        self.project.rename(moved)
        self.project = moved
        self.assertIn("setup: making the virtual environment .venv", self.run_setup())
        self.assert_ready()

    def test_half_unpacked_sources_are_fetched_anew(self):
        (self.project / ".deps/unpacked/pip-download-x/subprojects").mkdir(parents=True)
        (self.project / ".deps/new").mkdir()
        self.run_setup()
        self.assert_ready()

    def test_clone_that_breaks_off_is_replaced(self):
        self.state(reachable="", clone_fails="")
        self.run_setup()
        self.assert_ready()

    def test_dangling_link_to_the_hdf5_modules_is_renewed(self):
        self.run_setup()
        link = self.project / "io/include/hdf5"
        link.unlink()
        link.symlink_to("/nonexistent")
        self.run_setup()
        self.assert_ready()

    # --- how it fails -------------------------------------------------------------------------------------------------

    def test_without_root_and_sudo_it_prints_the_line_to_type(self):
        self.state(uid="1000\n", absent="crt1.o\nliblapack.so\n")
        lines = self.run_setup(expect=2)
        self.assertEqual(
            lines[-1],
            "su -c 'apt-get update && apt-get install -y --no-install-recommends libc6-dev libopenblas-dev'",
        )
        self.assertEqual(len(lines), 2)
        self.assertFalse((self.project / ".venv").exists())

    def test_sudo_with_a_password_prints_the_line_to_type(self):
        self.state(uid="1000\n", absent="libhdf5_serial_fortran.so\n")
        self.stand_in("sudo", "exit 1")
        lines = self.run_setup(expect=2)
        self.assertEqual(
            lines[-1], "sudo apt-get update && sudo apt-get install -y --no-install-recommends libhdf5-dev"
        )
        self.assertFalse(any(call.startswith("apt-get") for call in self.calls()))

    def test_no_apt_get(self):
        self.state(absent="liblapack.so\n")
        (self.bin / "apt-get").unlink()
        lines = self.run_setup(expect=2)
        self.assertIn("libopenblas-dev", lines[-2])
        self.assertIn("no apt-get", lines[-1])

    def test_apt_get_fails(self):
        self.state(absent="liblapack.so\n", apt_fails="")
        lines = self.run_setup(expect=2)
        self.assertIn("    E: Unable to locate package", lines)
        self.assertIn("setup: apt-get could not install: libopenblas-dev", lines)

    def test_installed_and_still_not_found(self):
        self.state(absent="liblapack.so\n", apt_helps_not="")
        lines = self.run_setup(expect=2)
        self.assertIn("still not found", lines[-2])
        self.assertIn(str(self.bin / "gfortran"), lines[-1])

    def test_old_compiler(self):
        self.state(version="11.4.0\n")
        lines = self.run_setup(expect=2)
        self.assertIn("gfortran 11.4.0", lines[-2])
        self.assertIn("12 or newer", lines[-2])

    def test_environment_cannot_be_made(self):
        self.state(venv_fails="")
        lines = self.run_setup(expect=1)
        self.assertIn("    Error: no space left", lines)
        self.assertIn("setup: python3 -m venv .venv failed.", lines)
        (self.fake / "venv-fails").unlink()
        self.run_setup()
        self.assert_ready()

    def test_pip_fails_for_the_build(self):
        self.state(pip_fails="")
        lines = self.run_setup(expect=1)
        self.assertIn("setup: pip could not install the packages of config/requirements-build.txt.", lines)
        self.assertIn("fpm 0.12", lines[-1])
        (self.fake / "pip-fails").unlink()
        self.run_setup()
        self.assert_ready()

    def test_other_version_of_fpm_does_not_stand_in(self):
        self.state(pip_fails="")
        self.stand_in("fpm", 'echo "Version:     0.10.1, alpha"')
        self.run_setup(expect=1)

    def test_pip_fails_for_the_tests(self):
        self.run_setup()
        self.state(pip_fails="")
        lines = self.run_setup("test", expect=1)
        self.assertIn("setup: pip could not install the packages of config/requirements-test.txt.", lines)
        self.assert_ready()

    def test_dependency_from_nowhere(self):
        self.run_setup()
        for place in (".deps", "build"):
            shutil.rmtree(self.project / place)
        self.state(pip_fails="")
        lines = self.run_setup(expect=1)
        self.assertRegex(lines[-2], r"could be had neither from \S+ nor from PyPI")
        self.assertIn("put a git clone of that tag into .deps/", lines[-1])
        self.assertEqual(sorted(os.listdir(self.project / ".deps")), ["lock", "setup.log"])
        self.assertFalse((self.project / "build").exists())

    def test_fpm_refuses_the_dependencies(self):
        self.state(fpm_fails="")
        lines = self.run_setup(expect=1)
        self.assertIn("    <ERROR> no", lines)
        self.assertIn("setup: fpm does not accept the dependencies.", lines)

    def test_folder_of_somebody_else(self):
        options = {}
        self.state(calls="")
        (self.fake / "calls").chmod(0o666)
        if os.geteuid() == 0:
            options["user"] = NOBODY
            # Whatever the umask is, of the clone and now.
            subprocess.run(["chmod", "-R", "go+rX", self.top], check=True)
            if subprocess.run(["test", "-e", self.project], **options).returncode != 0:
                self.skipTest("the folder for temporary files is shut to the user nobody")
        else:
            self.project.chmod(0o555)
            self.addCleanup(self.project.chmod, 0o755)
        lines = self.run_setup(expect=2, **options)
        self.assertIn(f"you may not write in {self.project}", lines[0])
        self.assertIn("chown", lines[1])


if __name__ == "__main__":
    unittest.main()
