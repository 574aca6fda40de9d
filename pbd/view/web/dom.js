"use strict";

// Helpers that all parts of the page use.
const element = (id) => document.getElementById(id);

function make(tag, text = "", properties = {}) {
  return Object.assign(document.createElement(tag), { textContent: text }, properties);
}

function draw(tag, attributes) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  return node;
}

// With a true minus sign (U+2212), and without a sign before zero.
function digits(value, places) {
  const text = value.toFixed(places);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
}

const degrees = (radians, places = 1) => `${digits((180 / Math.PI) * radians, places)}°`;
