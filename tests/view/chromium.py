"""A headless Chromium that needs no graphics card, for tests, benchmarks and the pictures in the docs."""

import json
import shutil
from pathlib import Path

from selenium.webdriver import Chrome, ChromeOptions
from selenium.webdriver.chrome.service import Service

OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--enable-webgl",
    "--ignore-gpu-blocklist",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--force-device-scale-factor=1",
)


class Chromium(Chrome):  # type: ignore[misc]  # selenium is not followed
    """A Chromium with its profile in a folder; its pages have 1200 x 750 pixels."""

    def __init__(self, binary: str, driver: str, profile: Path) -> None:
        options = ChromeOptions()
        options.binary_location = binary
        for option in (*OPTIONS, f"--user-data-dir={profile}"):
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        super().__init__(options=options, service=Service(driver))
        self.set_size()
        self.set_media()

    def set_size(self, width: int = 1200, height: int = 750) -> None:
        """Set the size of pages, pixels; return when the page has seen it."""
        self.size = width, height
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        self.execute_async_script("const [seen] = arguments; requestAnimationFrame(() => requestAnimationFrame(seen));")

    def set_media(self, scheme: str = "light", motion: str = "reduce") -> None:
        """Set what the user prefers.

        Args:
            scheme: of colours, "light" or "dark".
            motion: "reduce" stops the automatic playback, which is slow; or "no-preference".
        """
        features = [
            {"name": f"prefers-{what}", "value": value}
            for what, value in (("color-scheme", scheme), ("reduced-motion", motion))
        ]
        self.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})

    def errors(self) -> list[str]:
        """Error messages since the last call, without the warning that software rendering is slow."""
        messages = [str(entry["message"]) for entry in self.get_log("browser")]
        return [message for message in messages if "GPU stall due to ReadPixels" not in message]

    def requests(self) -> set[str]:
        """Addresses requested since the last call, without the browser's own (chrome:)."""
        events = [json.loads(entry["message"])["message"] for entry in self.get_log("performance")]
        asked = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
        sockets = [event["params"] for event in events if event["method"] == "Network.webSocketCreated"]
        addresses = {str(each["request"]["url"]) for each in asked} | {str(each["url"]) for each in sockets}
        return {address for address in addresses if not address.startswith(("chrome", "data:", "about:"))}


def chromium(profile: Path) -> Chromium | None:
    """Start one; None if it or its driver is not on PATH."""
    binary = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    return Chromium(binary, driver, profile) if binary and driver else None
