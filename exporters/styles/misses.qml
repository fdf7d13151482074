<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Strips not worked: purple with a black edge, paler along the boundary. -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips">
 <renderer-v2 type="categorizedSymbol" attr="kind" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <categories>
   <category value="between passes" type="string" symbol="0" label="missed between passes" render="true"/>
   <category value="boundary" type="string" symbol="1" label="missed along the boundary" render="true"/>
   <category value="" type="string" symbol="2" label="other" render="true"/>
  </categories>
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="123,31,162,235"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="123,31,162,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.4"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
   <symbol type="fill" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="123,31,162,150"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="123,31,162,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.4"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
   <symbol type="fill" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="123,31,162,235"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="123,31,162,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.4"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <mapTip enabled="1">&lt;b&gt;missed&lt;/b&gt;: [% "kind" %]&lt;br&gt;[% coalesce(format_number("area_m2", max(0, 1 - floor(log10(2 * "area_sigma_m2")))) || ' ± ' || format_number(round(2 * "area_sigma_m2", 1 - floor(log10(2 * "area_sigma_m2"))), max(0, 1 - floor(log10(2 * "area_sigma_m2")))) || ' m² (95 %)', format_number("area_m2", 1) || ' m²') %]</mapTip>
</qgis>
